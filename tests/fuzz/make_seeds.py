"""The seeds of `tools/fuzz`, small whole files of every format: ``python -m tests.fuzz.make_seeds`` writes them.

Nothing here was recorded: the frames are made up, the files are written by this package, by python-can, by
asammdf through python-can, or by hand after the formats' descriptions, as in the tests beside.
"""

import gzip
import json
import re
from pathlib import Path

from dctorque_can.logs.convert import write_frames
from dctorque_can.logs.mcap.layout import FD_FRAME_TYPE
from dctorque_can.pipeline.frames import EXTENDED_ID, FrameFlag

from ..bus.test_dbc_prepare import GOOD
from ..logs.blf.crafted import container, write_blf
from ..logs.frames_strategy import frame, frames_of
from ..logs.mcap.crafted import cdr_fd_frame, cdr_frame, chunk, definitions, message, write_mcap
from ..logs.mcap.test_foreign import SCHEMA, big_endian, channel, ros1, socketcan_fd
from ..logs.test_fuzz import blf_objects
from ..logs.text.test_csv import TABLES

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
START = 1_700_000_000_000_000

ASC = {
    "relative": """date Thu Apr 28 10:44:52.480 am 2022
base hex  timestamps relative
internal events logged
Begin Triggerblock Thu Apr 28 10:44:52.480 am 2022
   0.000000 Start of measurement
   0.010000 1  123             Rx   d 8 00 01 02 03 04 05 06 07
   0.010000 2  18FEF100x       Tx   d 2 01 02
   0.010000 1  ErrorFrame
   0.010000 1  124             Rx   r
   0.010000 CANFD   1 Rx        125                                   1 0 9 12 0 1 2 3 4 5 6 7 8 9 a b
End TriggerBlock
""",
    "comma": """date Don Apr 28 10:44:52.480 2022
base dec  timestamps absolute
no internal events logged
   0,010000 1  291             Rx   d 8 0 1 2 3 4 5 6 255
   0,020000 1  291             Rx   d 1 17  Length = 230 BitCount = 119 ID = 291
   0,030000 1  Statistic: D 0 R 0 XD 0 XR 0 E 0 O 0 B 0.00%
""",
}
CANDUMP = {
    "screen": """ (1583020909.559575)  can0  49C   [8]  7F 6C F6 12 44 FB 2C 1C
 (1583020909.760000)  can1  123  [12]  01 02 03 04 05 06 07 08 09 0A 0B 0C
 (1583020909.770000)  can0  20000004   [8]  00 00 00 00 00 00 00 00   ERRORFRAME
 (1583020909.780000)  can0  18FEF100   [0]  remote request
""",
    "raw_dlc": """(1700000000.000000) can0 123#0102030405060708_E
(1700000000.010000) can0 124#R8_9
(1700000000.020000) vcan1 18FEF100##3AABB
(1700000000.030000) can0 20000004#0000000000000000 R
""",
}
TRC = {
    "1_1": """;$FILEVERSION=1.1
;$STARTTIME=43474.6149468
;   Message Number
     1)      17.1  Rx         0300  8  00 00 00 00 04 00 00 00
     2)      27.4  Tx     18EFC034  4  01 02 03 04
     3)      30.0  Rx         0124  2  RTR
""",
    "1_3": """;$FILEVERSION=1.3
;$STARTTIME=43474.6149468
     1)      17.535 1  Tx        300 -  8    00 00 00 00 04 00 00 00
     2)      18.000 2  Rx    18EFC034 -  1    FF
""",
    "2_0": """;$FILEVERSION=2.0
;$STARTTIME=43474.6149468
;$COLUMNS=N,O,T,I,d,l,D
     1    1059.900 DT     0300 Rx 7  00 00 00 00 04 00 00
     2    1060.000 DT 18EFC034 Tx 2  01 02
""",
}
DBC_ALL = """VERSION "1"
NS_ :
\tBA_
BS_: 500
BU_: ECU TCU
VAL_TABLE_ OnOff 0 "off" 1 "on" ;
BO_ 256 Engine: 8 ECU
 SG_ Speed m0 : 7|16@0- (0.25,-1) [-100|100] "rpm" TCU
 SG_ Mode M : 16|4@1+ (1,0) [0|15] "" TCU
 SG_ Torque m1 : 32|32@1- (1,0) [0|0] "Nm" Vector__XXX
BO_ 2566844926 Extended: 8 Vector__XXX
 SG_ Gear : 0|4@1+ (1,0) [0|0] "°" Vector__XXX
BO_TX_BU_ 256 : ECU,TCU;
EV_ Switch: 0 [0|1] "" 0 1 DUMMY_NODE_VECTOR0 Vector__XXX;
CM_ "of the file"; CM_ BU_ ECU "engine
in two lines"; CM_ BO_ 256 "m"; CM_ SG_ 256 Speed "of the \\"crankshaft\\"";
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;
BA_DEF_ "BusType" STRING ;
BA_DEF_ SG_ "Kind" ENUM "a","b";
BA_DEF_REL_ BU_SG_REL_ "GenSigTimeout" INT 0 100;
BA_DEF_DEF_ "GenMsgCycleTime" 0;
BA_DEF_DEF_ "BusType" "CAN";
BA_DEF_DEF_ "Kind" "a";
BA_DEF_DEF_REL_ "GenSigTimeout" 0;
BA_ "GenMsgCycleTime" BO_ 256 10;
BA_ "Kind" SG_ 256 Speed 1;
VAL_ 256 Mode 0 "off" 1 "on" ;
SIG_VALTYPE_ 256 Torque : 1;
SIG_GROUP_ 256 Group 1 : Speed Torque;
SG_MUL_VAL_ 256 Torque Mode 1-1, 3-5;
"""
BROKEN = """VERSION ""
BO_ 256 Engine: 8 ECU
 SG_ Speed : 0|16@1+ (.25,0) [0|0] "rpm" ECU
 SG_ Much : 60|16@1+ (1,0) [0|0] "" ECU
 SG_ 2nd : 20|4@1+ (1,0) [0|0] "" ECU
BO_ 419361024 2017_5: 8
 SG_ S : 0|8@1+ (1,0) [0|0] ""
CM_ SG_ 256 "no name";
CM_ BO_ 256 "no end"
BA_DEF_ BO_ "Use" ENUM "false","true";
BA_DEF_DEF_ "Use" false;
BA_ "Unknown" BO_ 256 1;
VAL_ 300 Colour 0 "red" ;
"""
SMALL_CAR = """name: small
vehicle: &v
  engine_inertia_kgm2: 0.2
  <<: {driven_axle: front}
databases: [../dbc/demo_car_one_gear.dbc, {file: nothing.dbc, strict: no}]
inputs:
  engine_speed: {signal: EngineData.EngineSpeed, unit: rpm, not_available: [0xFFFF], timeout_ms: 1e2}
  engine_torque:
    sum: [{signal: EngineData.EngineTorque, factor: -.5}, {signal: EngineData.EngineTorque}]
    times: {signal: EngineData.EngineSpeed}
gears: {source: ratio}
clutch_phase: {source: none}
estimator: {method: kalman, period_ms: 10}
can: {interface: virtual, channel: 0, bitrate: 500000}
logging: {directory: "out\\0put", signals: true}
"""


def some_frames(wide=True, kinds=True):
    rows = [frame(START + 10_000 * i, 0x100 + i, bytes(range(i % 9)), channel=i % 2) for i in range(5)]
    rows.append(frame(START + 60_000, 0x18FEF100 | EXTENDED_ID, bytes(8)))
    if wide:
        rows.append(frame(START + 70_000, 0x200, bytes(range(64)), FrameFlag.FD | FrameFlag.BITRATE_SWITCH))
    if kinds:
        rows.append(frame(START + 80_000, 0x201, b"", FrameFlag.REMOTE, length=4))
        rows.append(frame(START + 90_000, 0, bytes(8), FrameFlag.ERROR))
        rows.append(frame(START + 100_000, 0x202, b"12", FrameFlag.TRANSMITTED))
    return frames_of(rows)


def without_comments(text):
    """Return YAML in which every byte counts."""
    return re.sub(r"\n+", "\n", re.sub(r" *# .*", "", text)).lstrip()


def main() -> None:
    def place(room, name):
        (HERE / room).mkdir(exist_ok=True)
        return HERE / room / name

    shipped = {path.stem: without_comments(path.read_text()) for path in (ROOT / "config").glob("*.yaml")}
    shipped["oh2014"] = shipped["paper_car"].replace("estimator:", "estimator:\n  method: oh2014")
    for room, texts, suffix in (
        ("asc", ASC, ".asc"),
        ("candump", CANDUMP, ".log"),
        ("trc", TRC, ".trc"),
        ("csv", {name.replace(" ", "_"): text for name, text in TABLES.items()}, ".csv"),
        ("dbc", {"good": GOOD, "all": DBC_ALL, "broken": BROKEN}, ".dbc"),
        ("configuration", {"small_and_wrong": SMALL_CAR, **shipped}, ".yaml"),
    ):
        for name, text in texts.items():
            place(room, name + suffix).write_text(text, encoding="utf-8")
    for room, suffix in (("asc", ".asc"), ("candump", ".log"), ("csv", ".csv"), ("trc", ".trc"), ("blf", ".blf")):
        narrow = suffix in (".csv", ".trc")
        write_frames(place(room, f"python_can{suffix}"), some_frames(not narrow, suffix != ".trc"))
    write_frames(place("mcap", "written.mcap"), some_frames())
    write_frames(place("mf4", "python_can.mf4"), some_frames())
    for name in ("screen", "raw_dlc"):
        place("gz", f"{name}.log.gz").write_bytes(gzip.compress(CANDUMP[name].encode(), mtime=0))
    two = gzip.compress(CANDUMP["screen"].encode(), mtime=0) * 2
    place("gz", "two_members.log.gz").write_bytes(two)
    objects = blf_objects()
    objects = objects[: len(objects) // 4]
    write_blf(place("blf", "objects.blf"), container(objects), container(objects, method=0), objects)

    payloads = {
        7: (definitions(number=7), cdr_frame(1)),
        8: (definitions(FD_FRAME_TYPE, number=8), cdr_fd_frame(2)),
        9: (
            channel("ros2_socketcan_msgs/msg/FdFrame", "ros2msg", "cdr", number=9),
            socketcan_fd(">", 3, 0, bytes(12)),
        ),
        10: (channel("can_msgs/Frame", "ros1msg", "ros1", number=10), ros1(4)),
        11: (definitions(number=11), big_endian(5)),
        12: (
            channel("Raw", "jsonschema", "json", json.dumps(SCHEMA), number=12),
            json.dumps({"timestamp": {"sec": 1, "nsec": 2}, "id": 6, "data": "0102"}).encode(),
        ),
    }
    known = b"".join(each for each, _ in payloads.values())
    messages = b"".join(message(payload, number) for number, (_, payload) in payloads.items())
    write_mcap(
        place("mcap", "foreign.mcap"), known, chunk(messages), chunk(messages, "lz4"), chunk(messages, "zstd")
    )
    write_mcap(place("mcap", "within.mcap"), chunk(known + messages, "zstd"), message(cdr_frame(9)))


if __name__ == "__main__":
    main()
