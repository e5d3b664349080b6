"""Contacts and hands for tests of the force in the hand."""

import numpy as np

from sonospline.contact import FrozenContact

SPACING = 1.8


def shaft(points=12, *, softness=1.0, friction=0.05, cutting=0.7, lateral=0.3, tip_mm=(0, 0, 0), axis=(0, 0, 1)):
    """A needle that tissue has closed on; 0.03 N/mm of friction, a stiffness of some 0.3 N/mm in all."""
    apart = np.subtract.outer(np.arange(points), np.arange(points)) * SPACING
    return FrozenContact.at_rest(
        places_mm=SPACING * np.arange(1 - points, 1), compliance_mm_n=softness / np.hypot(1, apart / 3.6),
        friction_n=friction, cutting_n=cutting, axis=axis, tip_mm=tip_mm, lateral_n_mm=lateral,
    )  # fmt: skip


def random_hands(count, seed):
    """What a FakeDevice takes of hands and wires, and where these hands want to be: no wilder than hands are."""
    rng = np.random.default_rng(seed)
    often, aside = rng.uniform(0.2, 4, count), rng.uniform(0, 0.2, count)
    far = np.minimum(rng.uniform(0.2, 20, count), 8000 / (2 * np.pi * often) ** 2)
    begin = rng.uniform(0, 2 * np.pi, (3, count))

    def wanted(now):
        along = far * np.sin(2 * np.pi * often * now + begin[2])
        path = np.stack([aside * far * np.sin(w * now + begin[i]) for i, w in enumerate((5, 7))] + [along], axis=1)
        return (1 - np.cos(np.pi * min(now / 0.25, 1))) / 2 * path

    device = {
        "hands": count, "mass_kg": rng.uniform(0.2, 1, count), "stiffness_n_mm": rng.uniform(0.05, 1, count),
        "damping_n_s_mm": rng.uniform(0.005, 0.02, count), "delay_ms": rng.uniform(0, 5, count), "jitter_ms": 0.5,
        "loss": 0.05, "quantum_mm": 0.005, "seed": seed,
    }  # fmt: skip
    return device, wanted
