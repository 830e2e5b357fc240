"""Digests of what decides a result."""

import hashlib

import numpy as np

from forest_addon.base.kept import digest


def test_digest_is_of_the_bytes_in_their_order_however_an_array_lies_in_memory():
    table = np.arange(12.0).reshape(3, 4)
    told = b"forest" + table.T.tobytes() + b'{"a": 1, "b": "x"}'
    wanted = hashlib.blake2b(told, digest_size=16).hexdigest()
    assert digest([b"forest", table.T, {"b": "x", "a": 1}]) == wanted
    assert digest(iter([b"forest", np.asfortranarray(table.T), {"a": 1, "b": "x"}])) == wanted
    assert digest([b"forest", table]) != digest([b"forest", table.T])
    assert digest([np.empty((0, 3)), 1]) == digest([1])


def test_every_number_of_a_long_array_within_settings_counts():
    track = np.zeros(5000)
    other = track.copy()
    other[2500] = 1e-9
    assert digest([{"track": track}]) != digest([{"track": other}])
    assert digest([{"track": track}]) == digest([{"track": track.copy()}])
