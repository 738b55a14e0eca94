"""An identified gear as MJCF: one hinge with the gear's friction and inertia, for MuJoCo 4 or, by the linear form, any.

The joint is the gear alone: put the link's mass in place of the body's inertia. MuJoCo's `damping` takes up to three
coefficients (F = d0 v + d1 v |v| + d2 v^3), its motor actuator a LuGre friction with exponent 2:

    z' = v - sigma0 |v|/g(v) z ,   F = sigma0 z + sigma1 z' ,   g(v) = F_c + (F_s - F_c) exp(-(v/v_s)^2)
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from xml.etree import ElementTree

from model.units import REVOLUTION
from rig.content.phrase import phrase
from rig.exchange.identified import IdentifiedGear
from rig.exchange.joint import Form, Joint
from rig.exchange.notes import NEVER, Meaning, Notes

BODY_INERTIA = 1e-6
"""kg m2, share of the joint's inertia that the body has: MuJoCo refuses a body without any."""
_BRISTLE_FREQUENCY = 50.0
"""Hz at which the gear's own inertia would ring on the bristles. Nothing was measured of them: they are stiff enough to
stick, and slow enough for a time step of 2 ms.
"""
_BRISTLE_DAMPING = 0.1
"""Damping ratio of that ringing; more would brake, for one step, a joint put at a speed with straight bristles."""
_INTEGRATOR = "Euler"
"""The implicit ones take h sigma1 for inertia: 6 % more of a CSF-25-120 at a step h of 1 ms."""
_OPEN_CIRCUIT = 1e12
"""ohm; the actuator is there for its friction, and shall not brake as a motor with closed windings does."""
_TIMESTEP = 1e-3


def mjcf_text(identified: IdentifiedGear, joint: Joint, form: Form) -> str:
    """The XML of a joint with this law of friction."""
    root = ElementTree.Element("mujoco", model=f"{joint.name} {joint.side}")
    root.append(ElementTree.Comment(_head(identified, joint, form)))
    ElementTree.SubElement(root, "compiler", angle="radian")
    ElementTree.SubElement(
        root, "option", timestep=_text(_TIMESTEP), integrator=_INTEGRATOR, gravity="0 0 0"
    )
    body = ElementTree.SubElement(
        ElementTree.SubElement(root, "worldbody"), "body", name=_body_name(joint)
    )
    share = _text(joint.inertia * BODY_INERTIA)
    body.append(ElementTree.Comment(" put your link here: its inertia is no part of the gear "))
    ElementTree.SubElement(
        body, "inertial", pos="0 0 0", mass="1e-3", diaginertia=f"{share} {share} {share}"
    )
    hinge = ElementTree.SubElement(
        body,
        "joint",
        name=joint_name(joint),
        type="hinge",
        axis="0 0 1",
        armature=_text(joint.inertia),
    )
    hinge.set("damping", " ".join(map(_text, _used(form))))
    if form.name != "lugre":
        hinge.set("frictionloss", _text(form.coulomb))
    else:
        actuator = ElementTree.SubElement(root, "actuator")
        stiffness, damping = bristles(joint)
        law = (stiffness, damping, form.coulomb, form.static, form.stribeck)
        ElementTree.SubElement(
            actuator,
            "dcmotor",
            name="friction",
            joint=joint_name(joint),
            motorconst="1",
            resistance=_text(_OPEN_CIRCUIT),
            lugre=" ".join(map(_text, law)),
        )
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _head(identified: IdentifiedGear, joint: Joint, form: Form) -> str:
    mark = phrase("{} ", identified.mark)
    # Two hyphens end a comment of XML.
    runs = ", ".join(one.run for one in identified.runs) or "a parameter set alone"
    words = f"{mark}{identified.gear.name}, ratio {joint.ratio:g}, seen from the {joint.side}; from {runs}"
    needs = "MuJoCo 4" if form.name != "linear" else "any MuJoCo"
    return f" {words.replace('--', '- -')}; SI; needs {needs} "


def _used(form: Form) -> tuple[float, ...]:
    """The coefficients of `damping`; older versions of MuJoCo take one."""
    return form.damping[:1] if form.name == "linear" else form.damping


def bristles(joint: Joint) -> tuple[float, float]:
    """sigma0 [N m/rad] and sigma1 [N m s/rad] of the bristles: the joint's inertia rings on them, a little damped."""
    omega = REVOLUTION * _BRISTLE_FREQUENCY
    return joint.inertia * omega**2, 2.0 * _BRISTLE_DAMPING * joint.inertia * omega


def joint_name(joint: Joint) -> str:
    """The hinge by its side."""
    return "wave_generator" if joint.side == "motor" else "output"


def _body_name(joint: Joint) -> str:
    return f"{joint_name(joint)}_body"


def mjcf_notes(
    identified: IdentifiedGear, joint: Joint, form: Form, forms: tuple[Form, ...], file: str
) -> Notes:
    """What each number of the file means in MuJoCo, and what it does not hold."""
    return Notes(
        title=f"{joint.name} as MJCF, seen from the {joint.side}",
        target="MuJoCo 4" if form.name != "linear" else "MuJoCo 2 to 4",
        joint=joint,
        meanings=tuple(_meanings(joint, form)),
        form=form.name,
        forms=forms,
        cannot=(
            *NEVER,
            *(_LUGRE_LACKS if form.name == "lugre" else _DRY_LACKS),
            "the motor's rotor and the load: they are no part of the gear",
        ),
        example=(
            "import mujoco",
            f'model = mujoco.MjModel.from_xml_path("{file}")',
            "data = mujoco.MjData(model)",
            f"data.qfrc_applied[0] = {1.5 * form.static:.3g}  # N m",
            "mujoco.mj_step(model, data, nstep=1000); print(data.qvel[0], 'rad/s')",
        ),
        remarks=identified.remarks,
    )


_UNITS = ("N m s/rad", "N m s2/rad2", "N m s3/rad3")
_LAWS = ("d0 v", "d1 v |v|", "d2 v^3")
_LUGRE_LACKS = (
    "friction before it slides: the bristles are chosen",
    "an implicit integrator: it would take timestep times sigma1 for inertia",
    "bristles that are bent from the start: put a joint at a speed with data.act[0] = F_c/sigma0",
)
_DRY_LACKS = (
    "the dip of friction over speed (Stribeck): static friction is that at speed",
    "dry friction at the slowest speeds: frictionloss is a soft constraint (--check shows where it is whole)",
)
"""What a law of friction does not hold before the joint slides."""


def _meanings(joint: Joint, form: Form) -> Iterator[Meaning]:
    """Each number of the file: of the joint, then of its law of friction."""
    yield Meaning("joint armature", f"{joint.inertia:.6g} kg m2", _inertia_words(joint))
    for power, (value, unit, law) in enumerate(zip(_used(form), _UNITS, _LAWS, strict=False)):
        yield Meaning(f"joint damping d{power}", f"{value:.6g} {unit}", f"torque {law}")
    coulomb = f"{form.coulomb:.6g} N m"
    if form.name != "lugre":
        yield Meaning("joint frictionloss", coulomb, "dry friction, a constraint of the solver")
        return
    stiffness, damping = bristles(joint)
    chosen = "bristles: chosen, not measured"
    for name, number, words in (
        ("F_c", coulomb, "friction at speed, without the polynomial"),
        ("F_s", f"{form.static:.6g} N m", "friction near standstill"),
        ("v_s", f"{form.stribeck:.6g} rad/s", "speed over which one becomes the other"),
        ("sigma0", f"{stiffness:.6g} N m/rad", chosen),
        ("sigma1", f"{damping:.6g} N m s/rad", chosen),
    ):
        yield Meaning(f"dcmotor lugre {name}", number, words)


def _inertia_words(joint: Joint) -> str:
    if joint.side == "joint":
        return "N^2 J_wg + J_g (what of it turns)"
    return "J_wg + J_g/N^2 (what of it turns)"


def _text(value: float) -> str:
    """A number that reads back to the same double."""
    if not math.isfinite(value):
        raise AssertionError("a number of a checked parameter set is finite")
    return repr(float(value))
