"""The words that names, comments and message names of DBCs are made of: English, German, French, abbreviated.

A name such as ``EngSpd``, ``nMot``, ``WHL_SPD_FL`` or ``Motordrehzahl`` is cut into tokens. Short abbreviations
must be a token; stems may stand anywhere within one, since German writes words together. No maker's signal is in
here, only words.
"""

from __future__ import annotations

import re
import unicodedata
from enum import Enum, auto
from functools import lru_cache
from itertools import pairwise


class Word(Enum):
    """A notion that a name may tell."""

    ENGINE = auto()
    GEARBOX = auto()
    CLUTCH = auto()
    SHAFT = auto()
    INPUT = auto()
    OUTPUT = auto()
    TURBINE = auto()
    WHEEL = auto()
    VEHICLE = auto()
    BRAKE = auto()
    STEERING = auto()
    ELECTRIC = auto()
    ACCESSORY = auto()  # fans, pumps, compressors, heating, radar, …
    PARKING = auto()
    SPEED = auto()
    TORQUE = auto()
    GEAR = auto()
    LEVER = auto()
    POSITION = auto()
    PEDAL = auto()
    PRESSURE = auto()
    LIGHT = auto()
    ACCELERATION = auto()
    LONGITUDINAL = auto()
    LATERAL = auto()
    GRADE = auto()
    DIRECTION = auto()
    SHIFT = auto()
    STATE = auto()
    ACTIVE = auto()
    ACTUAL = auto()
    TARGET = auto()
    DRIVER = auto()
    LIMIT = auto()
    IDLE = auto()
    FILTERED = auto()
    DISPLAY = auto()
    RATE = auto()
    RATIO = auto()
    INDICATED = auto()
    NET = auto()
    FRICTION = auto()
    INERTIA = auto()
    REFERENCE = auto()
    INTERVENTION = auto()
    VALIDITY = auto()
    COUNTER = auto()
    CHECKSUM = auto()
    PULSES = auto()
    TEMPERATURE = auto()
    TIME = auto()
    LOW_PART = auto()
    HIGH_PART = auto()


_TOKENS: dict[Word, str] = {
    Word.ENGINE: "eng engine mot ice vm nmot ems ecm ecu dme pcm crank cran crk kw nengine neng moteur cmm",
    Word.GEARBOX: (
        "trn trans transm getr gearbox gbx gbox tcu tcm tcmu dct dsg gs egs tx at bv bva bvm ge dkg pdk edc"
    ),
    Word.CLUTCH: "clt clth clu clch clutch kup kuppl k1 k2 clt1 clt2 cl1 cl2 tc1 tc2 embr c1 c2",
    Word.SHAFT: "iss oss shaft shft sft welle wel gw arbre axle",
    Word.INPUT: "iss in inp input ip ain ein prim primary nin entree is prm",
    Word.OUTPUT: "oss out outp output aout op aus ab sek sec secondary nout sortie os",
    Word.TURBINE: "tc turb turbine nt wandler converter conv wk tcc",
    Word.WHEEL: "whl wheel wheels rad raeder wss ws roue whlspd wspd vwhl nwhl",
    Word.VEHICLE: "veh vehicle fzg car fahrzeug vehv",
    Word.BRAKE: "brk brake braking brakes brems bremse bls br frein brkpdl mcp mcyl",
    Word.STEERING: "str steer steering strg lenk eps mdps lkas hca ste stg direction_assistee sas colmn column",
    Word.ELECTRIC: (
        "em emot emotor ema emachine motrac mtrtrac elm hyb hybrid hev isg bsg generator mg1 mg2 stm mtr ev"
    ),
    Word.ACCESSORY: (
        "fluid trailer trlr pad wear vacuum booster boost "
        "fan pump pmp comp cmpr compressor elcmpr ac hvac clim klima fatc blower water oil turbo alt "
        "alternator scr dosing wiper wash seat window radio radar acan opi cooling awd 4wd allrad lck "
        "lock hldc tpms tire tyre start"
    ),
    Word.PARKING: "park parking prk prkbrk epb handbrake hand feststell fbr hbr",
    Word.SPEED: (
        "iss oss ws spd speed rpm n nr vel velocity v w drehz drehzahl dz geschw nmot nin nout spdr rev "
        "revs wss omega vit"
    ),
    Word.TORQUE: "trq torq torque tq tqi tqe tqfr mom moment md mi couple trqe tqr drehmoment moments tor",
    Word.GEAR: "gear gang gr gea rapport gears actgear gearact",
    Word.LEVER: "lever lvr lev selector sel shifter prnd prndl waehlhebel wh gsm range fahrstufe sld",
    Word.POSITION: "pos posn position weg stellung travel stroke hub trvl",
    Word.PEDAL: "pdl pedal ped pedl pedals",
    Word.PRESSURE: "press pres prs pressure druck p dr cyl",
    Word.LIGHT: "light lamp licht leuchte lmp",
    Word.ACCELERATION: "accel acc acceleration accn beschl a ax accl",
    Word.LONGITUDINAL: "long lon longit longitudinal laengs ax lgt lng x",
    Word.LATERAL: "lat lateral quer ay yaw gier",
    Word.GRADE: "grade slope gradient_road incl inclination steig neig hang grd pente slp",
    Word.DIRECTION: "dir dirn direction richtung rotat fahrtrichtung sens",
    Word.SHIFT: "shift shft shftg shifting schalt gearshift",
    Word.STATE: "st stat sta state status zustand stg",
    Word.ACTIVE: "act actv active aktiv akt applied appd pressed on sw switch",
    Word.ACTUAL: "act actl actual ist cur curr current meas measured av aktuell engaged engd estd",
    Word.TARGET: (
        "tgt tar trg trgt target soll solld des desired dsrd req rq rqst reqd request requested cmd "
        "command cmnd demand dmd set setp setpoint sp wunsch wu vorgabe anf ziel demande consigne vorhalt "
        "nset rqd next presel preselected rec rcmd advice suggest"
    ),
    Word.DRIVER: "drv drvr driver fahrer conducteur fw",
    Word.LIMIT: (
        "max min lim limit mx mn allow mxallw mnallw begr grenz upper lower maximum minimum avl lmt maxi mini cap"
    ),
    Word.IDLE: "idl idle ll llr leerlauf ralenti",
    Word.FILTERED: "filt flt fltd filtered gefiltert avg average avrg mean mittel smooth smoothed ref",
    Word.DISPLAY: "disp dsply display anz anzeige cluster dash ipc kombi hud indication",
    Word.RATE: "rate grad gradient dt roc deriv der diff delta",
    Word.RATIO: "ratio rat uebersetzung rt",
    Word.INDICATED: "ind indic indicated indiziert tqi innere inneres mi combustion ti",
    Word.NET: "net netto eff effective clth_net fly flywheel brakeeff crankshaft mdkup",
    Word.FRICTION: "fric frc frct friction reib tqfr fr_tq loss losses lss lost verl verlust schub drag mr",
    Word.INERTIA: "inertia traegheit traeg inert",
    Word.REFERENCE: "std stnd standard ref reference norm nominal nenn refer bezug",
    Word.INTERVENTION: (
        "tcs asr msr esp esc esr dsc acc scc abs tsc etc cmbb aeb gearreq tcsabs eingr eingriff interv "
        "apa hsa acor slw fst"
    ),
    Word.VALIDITY: (
        "valid vld qf qbit qual quality err error fail fault flt fehler diag dg inacc unplausibel plaus "
        "def defect v_flag flag flg avail available"
    ),
    Word.COUNTER: (
        "cnt cntr counter alive alv alvcnt alivecounter rc bz msgcnt cnt_ roll rolling sqc msgcounter "
        "botschaftszaehler"
    ),
    Word.CHECKSUM: (
        "chk crc cs chks chksum checksum csum chksm cksum pruefsumme pz chsum checksumme bcc sum chkssm"
    ),
    Word.PULSES: "pul pulse pulses edge edges impuls ticks wic",
    Word.TEMPERATURE: "temp tmp temperature temperatur tem tmpr",
    Word.TIME: "time zeit duration tm",
    Word.LOW_PART: "lsb low lo",
    Word.HIGH_PART: "msb high hi",
}
_STEMS: dict[Word, str] = {
    Word.ENGINE: "engine motor moteur crankshaft kurbelwelle",
    Word.GEARBOX: "getriebe gearbox transmission transaxle boite",
    Word.CLUTCH: "clutch cltch kupplung kuppl embrayage",
    Word.SHAFT: "iss oss shaft welle arbre",
    Word.INPUT: "eingang input antriebsw primaer",
    Word.OUTPUT: "abtrieb output ausgang sekundaer",
    Word.TURBINE: "turbin wandler converter",
    Word.WHEEL: "wheel radgeschw raddreh radgeschwind radmoment",
    Word.VEHICLE: "vehicle fahrzeug",
    Word.BRAKE: "brake braking brems frein",
    Word.STEERING: "steer lenk",
    Word.ELECTRIC: "emaschine emotor electricmotor elektromotor hybrid traction",
    Word.ACCESSORY: "kompressor compressor luefter luefterrad klima pumpe tachome allrad",
    Word.PARKING: "parkbrake handbrake feststell parking",
    Word.SPEED: "speed drehzahl drehz geschw velocity vitesse regime",
    Word.TORQUE: "torque moment",
    Word.GEAR: "gear zielgang istgang sollgang gangpos ganganz ganginfo gangstufe gangwahl gangziel fahrgang",
    Word.LEVER: "waehlhebel lever selector shifter fahrstufe",
    Word.POSITION: "position stellung",
    Word.PEDAL: "pedal",
    Word.PRESSURE: "pressure druck",
    Word.LIGHT: "light licht lampe",
    Word.ACCELERATION: "accel beschl",
    Word.LONGITUDINAL: "longitud laengs",
    Word.LATERAL: "lateral querbe",
    Word.GRADE: "slope steigung neigung inclin roadgrade",
    Word.DIRECTION: "direction richtung",
    Word.SHIFT: "shifting schaltung schaltvorgang gearshift gangwechsel shiftinprog schaltablauf",
    Word.STATE: "status zustand",
    Word.ACTIVE: "pressed betaetigt aktiv applied getreten",
    Word.ACTUAL: "actual aktuell istmom istgang istwert istdreh measured",
    Word.TARGET: (
        "target recomm empfehl suggest wunsch desired request demand zielgang sollmom solldreh sollgang "
        "sollwert setpoint vorgabe command"
    ),
    Word.DRIVER: "driver fahrer",
    Word.LIMIT: "maxim minim limit begrenz grenzk schutz maxmom verfuegbar freigabe",
    Word.IDLE: "leerlauf idle",
    Word.FILTERED: "filter average gemittelt",
    Word.DISPLAY: "anzeige display cluster",
    Word.RATE: "gradient",
    Word.RATIO: "uebersetzung",
    Word.INDICATED: "indiziert indicated inneres combustion",
    Word.NET: "flywheel schwungrad",
    Word.FRICTION: "friction verlust reib schubmom schleppmom",
    Word.INERTIA: "traegheit inertia",
    Word.REFERENCE: "referenz reference nenndreh bezugsmom",
    Word.INTERVENTION: "eingriff interven",
    Word.VALIDITY: "invalid fehler error fault failure",
    Word.COUNTER: "counter zaehler alive",
    Word.CHECKSUM: "checksum chksum pruefsum pruefzif",
    Word.PULSES: "pulse impuls",
    Word.TEMPERATURE: "temperat",
    Word.TIME: "",
}
_BY_TOKEN: dict[str, set[Word]] = {}
for _word, _tokens in _TOKENS.items():
    for _token in _tokens.split():
        _BY_TOKEN.setdefault(_token, set()).add(_word)
_BY_STEM = [(stem, word) for word, stems in _STEMS.items() for stem in stems.split()]

_LEFT = {"l", "left", "lft", "li", "links", "gauche", "lh", "lt"}
_RIGHT = {"r", "right", "rgt", "re", "rechts", "droit", "droite", "rh", "rt", "ri"}
_FRONT = {"f", "fr", "frt", "frnt", "fnt", "front", "v", "vo", "vorn", "vorne", "vorder", "av", "avant"}
_REAR = {"r", "rr", "re", "rear", "h", "hi", "hinten", "hinter", "bck", "back", "ar", "arriere"}
_WHEELS = {
    **{
        "fl": "fl",
        "lf": "fl",
        "vl": "fl",
        "fr": "fr",
        "rf": "fr",
        "vr": "fr",
    },
    **{
        "rl": "rl",
        "lr": "rl",
        "hl": "rl",
        "rr": "rr",
        "hr": "rr",
    },
}
_LONG_WORD = 5
_CUT = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+")


def plain(text: str) -> str:
    """Return text without accents; ä, ö, ü and ß as German writes them in ASCII."""
    for letter, written in (
        ("ä", "ae"),
        ("ö", "oe"),
        ("ü", "ue"),
        ("Ä", "Ae"),
        ("Ö", "Oe"),
        ("Ü", "Ue"),
        ("ß", "ss"),
    ):
        text = text.replace(letter, written)
    return unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode("ascii")


@lru_cache(maxsize=100_000)
def tokens(text: str) -> tuple[str, ...]:
    """Return the words of a name or a comment, in lower case: cut at signs, at digits and where capitals begin."""
    return tuple(token.lower() for token in _CUT.findall(plain(text)))


@lru_cache(maxsize=100_000)
def words(text: str) -> frozenset[Word]:
    """Return the notions that a name or a comment tells."""
    found: set[Word] = set()
    cut = tokens(text)
    whole = {part.lower() for part in re.split(r"[^A-Za-z0-9]+", plain(text))}  # K1, MG2, 4WD
    for token in {*cut, *whole}:
        found |= _BY_TOKEN.get(token, set())
        found |= {word for stem, word in _BY_STEM if stem in token}
    if Word.TORQUE in found and "fr" in cut:  # a wheel has no such torque
        found.add(Word.FRICTION)
    return frozenset(found)


@lru_cache(maxsize=100_000)
def unknown_words(name: str) -> tuple[str, ...]:
    """Return the longer words of a name that mean nothing here; they may change what it says."""
    known = _LEFT | _RIGHT | _FRONT | _REAR
    return tuple(
        token
        for token in tokens(name)
        if len(token) >= _LONG_WORD and token not in known and not words(token) and not wheel_of(token)
    )


@lru_cache(maxsize=100_000)
def wheel_of(name: str) -> str:
    """Return which wheel a name tells: "fl", "fr", "rl", "rr", or "" for none."""
    cut = [token for token in tokens(name) if not token.isdigit()]
    for first, second in pairwise(cut):
        for axle, side in ((first, second), (second, first)):
            front, rear = axle in _FRONT, axle in _REAR
            left, right = side in _LEFT, side in _RIGHT
            if (front or rear) and (left or right) and not (len(axle) == 1 and len(side) == 1 and axle == side):
                return ("f" if front else "r") + ("l" if left else "r")
    for token in reversed(cut):
        if token in _WHEELS:
            return _WHEELS[token]
    for token in cut:  # radgeschwvl, flwheelspd
        for part, rest in ((token[-2:], token[:-2]), (token[:2], token[2:])):
            if part in _WHEELS and Word.WHEEL in words(rest):
                return _WHEELS[part]
    return ""


@lru_cache(maxsize=100_000)
def number_of(name: str) -> int:
    """Return whether a name is about shaft or clutch 1 or 2; 0 where it says neither, or both.

    Words for odd and even gears say it too: gears 1, 3, 5 are on shaft 1.
    """
    text = plain(name).lower()
    if re.search(r"odd|ungerad|impair", text):
        return 1
    if re.search(r"even|gerad|pair", text):
        return 2
    numbers = {int(token) for token in tokens(name) if token in ("1", "2", "01", "02")}
    after = re.findall(r"(?:clutch|clt|cl|kuppl(?:ung)?|k|c|shaft|in(?:put)?|welle|is|w)_?0?([12])(?!\d)", text)
    chosen = {int(each) for each in after} or numbers
    return chosen.pop() if len(chosen) == 1 else 0
