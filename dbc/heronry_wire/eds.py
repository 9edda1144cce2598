"""The electronic data sheet (EDS) of a PE: its object dictionary in the format that CANopen tools read (CiA 306-1).

The EDS is written from `canopen_objects`, without a time, a path or a node-ID; `$NODEID` stands for the node-ID. So
three files are equal: the shipped file, the output of `heronry eds`, and the file that a PE gives by SDO (object
1021h). Arrays with one element per module are written in the compact form, in which the node itself gives the number of
elements.
"""

from collections.abc import Iterator, Sequence

from heronry_wire.canopen_objects import (
    BIT_RATES,
    MOST_ELEMENTS,
    OBJECTS,
    PRODUCT_CODE,
    REVISION,
    VENDOR_ID,
    Entry,
    Kind,
    Type,
    Variable,
)

FILE_NAME = "heronry_pe.eds"
_MANDATORY = (0x1000, 0x1001, 0x1018)
_FIRST_OWN, _LAST_OWN = 0x2000, 0x5FFF


def eds_text() -> str:
    """Return the whole content of the EDS file."""
    return "\n".join(line for section in _sections() for line in section)


def _sections() -> Iterator[list[str]]:
    yield _section("FileInfo", FileName=FILE_NAME, FileVersion=1, FileRevision=REVISION & 0xFFFF, EDSVersion="4.0")
    yield _section(
        "DeviceInfo",
        VendorName="heronry",
        VendorNumber=f"0x{VENDOR_ID:08X}",
        ProductName="heronry PE",
        ProductNumber=f"0x{PRODUCT_CODE:08X}",
        RevisionNumber=f"0x{REVISION:08X}",
        OrderCode="",
        **{f"BaudRate_{rate // 1000}": 1 for rate in BIT_RATES},  # all: the spec fixes the bit rate
        SimpleBootUpMaster=0,
        SimpleBootUpSlave=1,
        Granularity=0,
        DynamicChannelsSupported=0,
        GroupMessaging=0,
        NrOfRXPDO=0,
        NrOfTXPDO=0,
        LSS_Supported=0,
    )
    yield _section("DummyUsage", **{f"Dummy{code:04}": 0 for code in range(1, 8)})
    yield _section("Comments", Lines=0)
    own = [entry for entry in OBJECTS if _FIRST_OWN <= entry.index <= _LAST_OWN]
    mandatory = [entry for entry in OBJECTS if entry.index in _MANDATORY]
    optional = [entry for entry in OBJECTS if entry not in own and entry not in mandatory]
    for title, entries in (
        ("MandatoryObjects", mandatory),
        ("OptionalObjects", optional),
        ("ManufacturerObjects", own),
    ):
        yield _list(title, entries)
        for entry in entries:
            yield from _entry(entry)


def _section(title: str, **values: object) -> list[str]:
    return [f"[{title}]", *(f"{key}={value}" for key, value in values.items()), ""]


def _list(title: str, entries: Sequence[Entry]) -> list[str]:
    numbered = [f"{number}=0x{entry.index:04X}" for number, entry in enumerate(entries, start=1)]
    return [f"[{title}]", f"SupportedObjects={len(entries)}", *numbered, ""]


def _entry(entry: Entry) -> Iterator[list[str]]:
    title, kind = f"{entry.index:04X}", f"0x{entry.kind.value:X}"
    if entry.kind in (Kind.VAR, Kind.DOMAIN):
        yield _variable(title, entry.variables[0], kind)
    elif entry.most == MOST_ELEMENTS:
        yield [*_variable(title, entry.variables[0], kind)[:-1], f"CompactSubObj={MOST_ELEMENTS}", ""]
    else:
        highest = entry.most or len(entry.variables)
        yield _section(title, ParameterName=entry.name, ObjectType=kind, SubNumber=f"0x{highest + 1:X}")
        for sub_index in range(highest + 1):
            variable = entry.variable(sub_index)
            assert variable is not None
            if sub_index and entry.most > 1:
                variable = variable._replace(name=f"{variable.name} {sub_index}")
            yield _variable(f"{title}sub{sub_index:X}", variable, f"0x{Kind.VAR.value:X}")


def _variable(title: str, variable: Variable, kind: str) -> list[str]:
    if kind == f"0x{Kind.VAR.value:X}" and variable.type is Type.DOMAIN:
        kind = f"0x{Kind.DOMAIN.value:X}"
    lines = [
        f"[{title}]",
        f"ParameterName={variable.name}",
        f"ObjectType={kind}",
        f"DataType=0x{variable.type.code:04X}",
        f"AccessType={variable.access.value}",
    ]
    if isinstance(variable.value, int):
        lines.append(f"DefaultValue={'$NODEID+' if variable.of_node else ''}0x{variable.value:X}")
    elif variable.value is not None:
        lines.append(f"DefaultValue={variable.value}")
    if variable.limits is not None:
        low, high = variable.limits
        lines += [f"LowLimit=0x{low:X}", f"HighLimit=0x{high:X}"]
    return [*lines, "PDOMapping=0", ""]
