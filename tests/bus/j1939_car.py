"""The demo car as one of J1939: the same messages with identifiers of 29 bits."""

from .demo import DBC

IDS = {256: 0x0CFF1000, 272: 0x0CFF1103, 288: 0x0CFF1203, 304: 0x18FF130B, 305: 0x18FF140B}
"""Identifier of demo_car.dbc to that of J1939: engine 0x00, gearbox 0x03, brakes 0x0B, as SAE numbers them."""


def j1939_dbc(*, declared: bool) -> str:
    """Return the DBC; with ``declared`` it says that it is one of J1939, as those of Vector do."""
    text = (DBC / "demo_car.dbc").read_text()
    for standard, extended in IDS.items():
        text = text.replace(f"BO_ {standard} ", f"BO_ {extended | 0x8000_0000} ")
        text = text.replace(f"SG_ {standard} ", f"SG_ {extended | 0x8000_0000} ")
        text = text.replace(f"VAL_ {standard} ", f"VAL_ {extended | 0x8000_0000} ")
    if declared:
        text += (
            '\nBA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";'
            '\nBA_DEF_DEF_ "VFrameFormat" "J1939PG";\n'
        )
    return text
