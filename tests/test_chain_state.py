"""A chain goes on from a state to the same bits, and never from one that is not its own or holds what none can."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from dctorque_can.chain import Chain
from dctorque_can.clutch_maps.maps import ClutchMaps
from dctorque_can.config.load import Config, load_config
from dctorque_can.offline.simulated_car import DriveName, ProfileName, simulate_car
from dctorque_can.pipeline.frames import Frames
from dctorque_can.resources import shipped_config
from dctorque_can.snapshot import Snapshot, packed

from .clutch_maps.car import capacity, rows_of, samples_of

KINDS: dict[str, dict[str, str]] = {
    "kalman": {},
    "oh2014": {"estimator.method": "oh2014"},
    "delays": {
        "inputs.engine_speed.delay_ms": "20",
        "inputs.engine_speed.max_rate": "3000",
        "inputs.engine_torque.timeout_ms": "learned",
    },
    "maps": {"clutch_map.enabled": "true"},
}
CUTS = 6
ODD = [
    0,
    1,
    -1,
    2,
    -2,
    7,
    15,
    16,
    17,
    31,
    255,
    2**31,
    -(2**31),
    2**53,
    2**60,
    -(2**62),
    2**61,
    2**63 - 1,
    -(2**63),
]
ODD_FLOATS = [0.0, -0.0, 1.0, -1.0, 1e-300, 1e9, -1e9, 1e300, np.inf, -np.inf, np.nan]


@cache
def configured(kind: str) -> Config:
    return load_config(shipped_config("paper_car"), KINDS[kind])


@cache
def driven() -> Frames:
    """Launch and first upshift with production signals."""
    return simulate_car(
        configured("kalman"), DriveName.PAPER, ProfileName.PRODUCTION, seed=3, duration_s=7.0
    ).frames


def moments(kind: str) -> tuple[Config, list[tuple[int, Snapshot, bytes]]]:
    """Return states at random frames of the drive, and their bytes."""
    config, frames = configured(kind), driven()
    cuts = np.sort(np.random.default_rng(7).integers(1, len(frames), CUTS)).tolist()
    chain, at, found = Chain(config), 0, []
    for cut in cuts:
        chain.feed(frames[at:cut])
        at = cut
        state = chain.state()
        found.append((cut, state, chain.packed(state)))
    return config, found


def fed(chain: Chain, frames: Frames) -> tuple[bytes, bytes, bytes]:
    estimates = chain.feed(frames)
    return estimates.rows.tobytes(), estimates.health.tobytes(), chain.map_rows().tobytes()


def begun(kind: str) -> Chain:
    return Chain(configured(kind))


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_frames_give_the_same_bits_from_a_state_on(kind: str) -> None:
    """Against the one chain that was fed from the beginning, and in other batches."""
    _, found = moments(kind)
    frames = driven()
    for cut, _, content in found:
        whole = begun(kind)
        whole.feed(frames[:cut])
        whole.map_rows()
        expected = fed(whole, frames[cut:])
        again = begun(kind)
        assert again.restore(content) == ""
        first, second = fed(again, frames[cut : cut + 777]), fed(again, frames[cut + 777 :])
        assert tuple(a + b for a, b in zip(first, second, strict=True)) == expected
        assert again.health.tobytes() == whole.health.tobytes()


def test_a_chain_that_uses_kept_maps_goes_on_to_the_same_bits_with_the_same_maps_alone() -> None:
    """Then there are two estimators, one of which knows the maps."""
    config = load_config(
        shipped_config("paper_car"), {"clutch_map.enabled": "true", "clutch_map.use_as_command": "true"}
    )
    frames = driven()

    def begun() -> Chain:
        assert config.clutch_map is not None
        maps = ClutchMaps(config.clutch_map)
        t_us = np.arange(0, 60_000_000, 10_000)
        x = 5.2 + 1.9 * np.sin(2e-6 * np.pi * t_us / 4.0)
        maps.take(samples_of(t_us, x), rows_of(t_us, capacity(x)))
        chain = Chain(config, maps=maps)
        assert chain.commands is not None
        return chain

    whole = begun()
    whole.feed(frames[:9000])
    whole.map_rows()
    content = whole.packed(whole.state())
    again = begun()
    assert again.restore(content) == ""
    assert fed(again, frames[9000:]) == fed(whole, frames[9000:])
    assert Chain(config).restore(content) == "it is of another kept clutch map"


def test_a_state_is_a_copy() -> None:
    chain, frames = begun("kalman"), driven()
    chain.feed(frames[:5000])
    state = chain.state()
    before = chain.packed(state)
    chain.feed(frames[5000:])
    assert chain.packed(state) == before


@pytest.mark.parametrize(
    ("overrides", "why"),
    [
        ({"vehicle.chassis.mass_kg": "1601"}, "it is of another vehicle file"),
        ({"estimator.method": "oh2014"}, "it is of another vehicle file"),
        ({"logging.flush_ms": "77"}, ""),
    ],
)
def test_a_state_of_another_vehicle_is_not_taken(overrides: dict[str, str], why: str) -> None:
    _, found = moments("kalman")
    chain = Chain(load_config(shipped_config("paper_car"), overrides))
    assert chain.restore(found[0][2]) == why


def test_a_state_of_another_version_or_database_is_not_taken() -> None:
    config, found = moments("kalman")
    chain = Chain(config)
    identity = dict(chain._identity)
    for key in identity:
        assert chain.restore(packed(found[0][1], identity | {key: "0"})) == f"it is of another {key}"


def test_a_chain_that_smooths_begins_anew() -> None:
    config, found = moments("kalman")
    assert Chain(config, smooth=True).restore(found[0][2]) == "smoothing begins anew"


def test_damaged_bytes_are_refused_with_one_line() -> None:
    """Bytes exchanged, lost and added: the checksum finds them all; with a new checksum the rest does or not."""
    config, found = moments("maps")
    rng = np.random.default_rng(1)
    chain, other = Chain(config), Chain(config)
    content = found[2][2]
    head = len(b"dctorque state 1\n") + 65
    for n in range(300):
        damaged = bytearray(content)
        for at in rng.integers(0, len(damaged), 1 + n % 5).tolist():
            damaged[at] ^= 1 << int(rng.integers(8))
        if n % 3 == 0:
            del damaged[int(rng.integers(len(damaged))) :]
        if n % 7 == 0:
            damaged += rng.bytes(9)
        why = chain.restore(bytes(damaged))
        assert why
        assert "\n" not in why
        body = bytes(damaged[head:])
        again = b"dctorque state 1\n" + hashlib.sha256(body).hexdigest().encode() + b"\n" + body
        why = other.restore(again)
        assert "\n" not in why
        if not why:
            other = Chain(config)


@pytest.mark.parametrize("kind", KINDS)
def test_no_number_of_a_state_leads_out_of_a_table_or_holds_up_a_loop(kind: str) -> None:
    """Each word of the memory gets what none has; what is taken over is fed. `tools/check` checks every index."""
    config, found = moments(kind)
    refused, taken = mutated(config, found, np.random.default_rng(5), 24)
    assert refused
    assert taken


def mutated(
    config: Config, found: list[tuple[int, Snapshot, bytes]], rng: np.random.Generator, tries: int
) -> tuple[int, int]:
    """Change states and feed what is taken over; return how many were refused and taken."""
    frames = driven()
    identity = dict(Chain(config)._identity)
    refused = taken = 0
    for n in range(tries):
        cut, state, _ = found[n % len(found)]
        chain = Chain(config)
        why = chain.restore(packed(changed(state, rng, 1 + n % 3), identity))
        assert "\n" not in why
        refused, taken = (refused + 1, taken) if why else (refused, taken + 1)
        estimates = chain.feed(frames[cut : cut + 900])
        chain.feed(frames[cut + 900 : cut + 1000])
        assert np.isfinite(estimates.rows["clutch1_torque_nm"]).all()
    return refused, taken


def changed(state: Snapshot, rng: np.random.Generator, places: int) -> Snapshot:
    """Return a state in which some words, numbers or lengths are other ones."""
    arrays: dict[str, np.ndarray[Any, Any]] = {name: array.copy() for name, array in state.arrays.items()}
    values = json.loads(json.dumps(state.values))
    for _ in range(places):
        kind = rng.integers(10)
        name = str(rng.choice(list(arrays)))
        if kind == 0 and len(arrays[name]):
            arrays[name] = arrays[name][: int(rng.integers(len(arrays[name])))]
        elif kind == 1 and values.get("maps"):
            values["maps"] = altered(values["maps"], rng)
        elif kind == 2:
            values = altered(values, rng)
        else:
            if kind > 4:
                name = "estimator memory"
            words = arrays[name].view(np.uint8)
            if not words.size:
                continue
            size = 8 if kind % 2 and words.size >= 8 else 1
            at = int(rng.integers(words.size // size)) * size
            odd = np.array([ODD_FLOATS[int(rng.integers(len(ODD_FLOATS)))]]).view(np.int64)
            if kind % 4:
                odd = np.array([ODD[int(rng.integers(len(ODD)))]], np.int64)
            words[at : at + size] = odd.view(np.uint8)[:size]
    return replace(state, arrays=arrays, values=values)


def altered(value: Any, rng: np.random.Generator) -> Any:
    """Return plain values of which one is another one."""
    if isinstance(value, dict) and value:
        key = str(rng.choice(list(value)))
        return {**value, key: altered(value[key], rng)}
    if isinstance(value, list) and value and rng.integers(8):
        at = int(rng.integers(len(value)))
        return [*value[:at], altered(value[at], rng), *value[at + 1 :]]
    odd: list[Any] = [None, "x", [], {}, True, 10**400, float("inf"), float("nan"), -1, 0, 1e300, 2**70, -1e-300]
    return odd[int(rng.integers(len(odd)))]


def test_the_words_of_a_state_are_plain() -> None:
    """Nothing of it is code: a line of JSON, and numbers."""
    _, found = moments("kalman")
    words: Mapping[str, Any] = json.loads(found[0][2].split(b"\n")[2])
    assert set(words) == {"identity", "values", "arrays"}
