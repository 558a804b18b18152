"""Data ids of known messages of Volkswagen's MQB platform, by the name that the common DBCs give them.

Solved from frames that were recorded in cars (`tests/bus/vw_mqb_frames.txt`): to a checksum and a counter just one
byte fits.
"""

from __future__ import annotations

DATA_IDS: dict[str, tuple[int, ...]] = {
    "ESP_02": (0xAA,) * 16,
    "ESP_05": (0x07,) * 16,
    "ESP_10": (0xAC,) * 16,
    "ESP_20": tuple(bytes.fromhex("ac b3 ab eb 7a e1 3b f7 73 ba 7c 9e 06 5f 02 d9")),
    "ESP_21": tuple(bytes.fromhex("b4 ef f8 49 1e e5 c2 c0 97 19 3c c9 f1 98 d6 61")),
    "ESP_33": tuple(bytes.fromhex("13 21 9b 6a 9a 62 d4 65 18 f1 ab 16 32 89 e7 26")),
    "Getriebe_11": tuple(bytes.fromhex("3f 69 39 dc 94 f9 14 64 d8 6a 34 ce a2 55 b5 2c")),
    "LH_EPS_03": (0xF5,) * 16,
    "LWI_01": (0x86,) * 16,
    "Motor_20": tuple(bytes.fromhex("e9 65 ae 6b 7b 35 e5 5f 4e c7 86 a2 bb dd eb b4")),
    "Motor_EV_01": tuple(bytes.fromhex("7f ed 17 c2 7c eb 44 21 01 fa db 15 4a 6b 23 05")),
    "TSK_06": tuple(bytes.fromhex("c4 e2 4f e4 f8 2f 56 81 9f e5 83 44 05 3f 97 df")),
}
