"""The EDS of every device: canopen loads it, and it describes exactly what the SDO server answers."""

from __future__ import annotations

import io

import pytest
from canopen import objectdictionary
from canopen.objectdictionary import eds

from sim_backend.wire.dictionary import TEXT, AbortError
from sim_backend.wire.eds import electronic_data_sheet
from tests.sim_backend.wire.slaves import analog, counter, drive

MAKERS = {"drive": drive, "counter": counter, "analog": analog}


def loaded(name: str):
    slave, _ = MAKERS[name]()
    text = electronic_data_sheet(
        slave.dictionary, product=name, vendor="simulated", vendor_number=0
    )
    return slave, eds.import_eds(io.StringIO(text), slave.node_id)


def variables(dictionary) -> dict[tuple[int, int], objectdictionary.ODVariable]:
    found = {}
    for index, entry in ((i, e) for i, e in dictionary.items() if i >= 0x1000):
        for variable in (
            [entry] if isinstance(entry, objectdictionary.ODVariable) else entry.values()
        ):
            found[index, variable.subindex] = variable
    return found


@pytest.mark.parametrize("name", MAKERS)
def test_the_eds_has_every_object_and_no_other(name: str) -> None:
    slave, dictionary = loaded(name)
    assert set(variables(dictionary)) == {(e.index, e.sub) for e in slave.dictionary}


@pytest.mark.parametrize("name", MAKERS)
def test_types_access_defaults_and_mapping_are_those_of_the_device(name: str) -> None:
    slave, dictionary = loaded(name)
    for (index, sub), variable in variables(dictionary).items():
        entry = slave.dictionary.entry(index, sub)
        where = f"0x{index:04X}:{sub}"
        assert variable.data_type == entry.type.code, where
        assert variable.pdo_mappable == bool(entry.mappable), where
        assert variable.readable, where
        assert variable.writable == (entry.access == "rw"), where
        if entry.type is not TEXT:
            assert variable.default == entry.default, where
        if index == 0x1003 and sub:
            continue  # answers only when there is an error to tell
        data = slave.dictionary.upload(index, sub)
        assert entry.type is TEXT or len(data) * 8 == len(variable), where
        if entry.access != "rw":
            with pytest.raises(AbortError):
                slave.dictionary.download(index, sub, data)


@pytest.mark.parametrize("name", MAKERS)
def test_what_is_not_in_the_eds_does_not_answer(name: str) -> None:
    slave, dictionary = loaded(name)
    present = variables(dictionary)
    for index in range(0x1000, 0x7000):
        for sub in (0, 1):
            if (index, sub) not in present:
                with pytest.raises(AbortError):
                    slave.dictionary.upload(index, sub)


def test_limits_and_numbers_of_pdos_are_told() -> None:
    _, dictionary = loaded("drive")
    assert (dictionary[0x6007].min, dictionary[0x6007].max) == (0, 3)
    assert dictionary.device_information.nr_of_TXPDO == 4
    assert dictionary.device_information.nr_of_RXPDO == 2
    assert dictionary.device_information.product_name == "drive"
