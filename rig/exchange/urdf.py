"""An identified gear as URDF: a revolute joint with friction, and a transmission with the ratio, by ROS' conventions.

SI and right-handed, as REP 103 has it: rad, N m, N m s/rad. `<dynamics>` is friction F = friction sgn(v) + damping v at
the joint; `<transmission>` names the reduction, by which a controller takes the motor's speed and torque.
"""

from __future__ import annotations

from collections.abc import Iterator
from xml.etree import ElementTree

from rig.content.phrase import phrase
from rig.exchange.identified import IdentifiedGear
from rig.exchange.joint import Form, Joint
from rig.exchange.mjcf import BODY_INERTIA, joint_name
from rig.exchange.notes import NEVER, Meaning, Notes


def urdf_text(identified: IdentifiedGear, joint: Joint, form: Form) -> str:
    """The XML of a robot of two links and the gear between them. `form` is the linear one: URDF has no other."""
    root = ElementTree.Element("robot", name=_word(joint.name))
    mark = phrase("{} ", identified.mark)
    words = f"{mark}{identified.gear.name}, ratio {joint.ratio:g}, seen from the {joint.side}; SI (REP 103)"
    root.append(ElementTree.Comment(f" {words.replace('--', '- -')} "))
    ElementTree.SubElement(root, "link", name="base")
    link = ElementTree.SubElement(root, "link", name="link")
    link.append(ElementTree.Comment(" put your link here: its inertia is no part of the gear "))
    inertial = ElementTree.SubElement(link, "inertial")
    ElementTree.SubElement(inertial, "mass", value="1e-3")
    share = repr(joint.inertia * BODY_INERTIA)
    ElementTree.SubElement(
        inertial, "inertia", ixx=share, iyy=share, izz=share, ixy="0", ixz="0", iyz="0"
    )
    hinge = ElementTree.SubElement(root, "joint", name=joint_name(joint), type="continuous")
    ElementTree.SubElement(hinge, "parent", link="base")
    ElementTree.SubElement(hinge, "child", link="link")
    ElementTree.SubElement(hinge, "axis", xyz="0 0 1")
    ElementTree.SubElement(
        hinge, "limit", effort=repr(joint.largest_torque), velocity=repr(joint.largest_speed)
    )
    ElementTree.SubElement(
        hinge, "dynamics", damping=repr(form.damping[0]), friction=repr(form.coulomb)
    )
    if joint.side == "joint":
        _add_transmission(root, joint)
    ElementTree.indent(root)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def _add_transmission(root: ElementTree.Element, joint: Joint) -> None:
    transmission = ElementTree.SubElement(root, "transmission", name=f"{joint_name(joint)}_gear")
    kind = ElementTree.SubElement(transmission, "type")
    kind.text = "transmission_interface/SimpleTransmission"
    ElementTree.SubElement(transmission, "joint", name=joint_name(joint))
    actuator = ElementTree.SubElement(transmission, "actuator", name="motor")
    reduction = ElementTree.SubElement(actuator, "mechanicalReduction")
    # The output turns against the wave generator where the circular spline is fixed.
    reduction.text = repr(joint.ratio)


def _word(name: str) -> str:
    """A name as ROS takes it: letters, digits and underscores."""
    return "".join(one if one.isalnum() else "_" for one in name)


def _meanings(joint: Joint, form: Form) -> Iterator[Meaning]:
    """Each number of the file: of the law of friction, then of the joint."""
    for name, number, words in (
        ("dynamics friction", f"{form.coulomb:.6g} N m", "dry friction; static is taken for equal"),
        ("dynamics damping", f"{form.damping[0]:.6g} N m s/rad", "friction that grows with speed"),
        ("limit effort", f"{joint.largest_torque:.6g} N m", "limit for repeated peak torque"),
        (
            "limit velocity",
            f"{joint.largest_speed:.6g} rad/s",
            "maximum input speed with this lubricant",
        ),
    ):
        yield Meaning(name, number, words)
    if joint.side == "joint":
        words = "motor revolutions per revolution of the joint"
        yield Meaning("mechanicalReduction", f"{joint.ratio:g}", words)


def urdf_notes(
    identified: IdentifiedGear, joint: Joint, forms: tuple[Form, ...], file: str
) -> Notes:
    """What each number of the file means in ROS, and what it does not hold."""
    form = next(one for one in forms if one.name == "linear")
    sense = "the sense of the output"
    if identified.mounting == "circular-spline-fixed":
        sense = "that the output turns against the wave generator"
    held = (
        "the gear's inertia: URDF has no armature; a controller or a plug-in needs "
        f"{joint.inertia:.6g} kg m2 at this side",
        "the dip of friction over speed (Stribeck)",
        sense,
        "the motor's rotor and the load: they are no part of the gear",
    )
    return Notes(
        title=f"{joint.name} as URDF, seen from the {joint.side}",
        target="URDF (ROS 1 and 2)",
        joint=joint,
        meanings=tuple(_meanings(joint, form)),
        form="linear",
        forms=forms,
        cannot=(*NEVER, *held),
        example=(
            "import xml.etree.ElementTree as ElementTree",
            f'root = ElementTree.parse("{file}").getroot()',
            'dynamics = root.find("joint/dynamics").attrib',
            "speed = 0.5  # rad/s at this side",
            'print(float(dynamics["friction"]) + float(dynamics["damping"]) * speed, "N m")',
        ),
        remarks=identified.remarks,
    )
