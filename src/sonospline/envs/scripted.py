"""Hands that act by rule, for comparison: what knows the way solves nearly all episodes, what does not, nearly none."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry.needle import Needle
from ..training.hands import probe_above
from .needle_steering import NeedleSteering
from .probe_navigation import ProbeNavigation

Array = NDArray[np.float64]
Action = NDArray[np.float32]
Policy = Callable[[Any], Action]
"""What returns an action for an environment as it is."""

_AIMED_DEG = 0.05
"""From which on a needle that is out counts as aimed."""


def steer(env: NeedleSteering) -> Action:
    """Aim at where the target is now, push, and follow it: looks at every step."""
    return _towards(env, env.episode.frame.target_now)


def steer_without_looking(env: NeedleSteering) -> Action:
    """Aim and push to where the target was before any tissue moved: what a plan on an image taken before does."""
    return _towards(env, env.episode.frame.target_rest)


def navigate(env: ProbeNavigation) -> Action:
    """Bring the probe above the target, its image along the needle."""
    episode = env.episode
    frame = episode.frame
    wanted = probe_above(episode.scene, episode.command, frame.entry, frame.target_now).probe
    return _action(env, [getattr(wanted, knob) - getattr(episode.command.probe, knob) for knob in env.rates])


def at_random(env: NeedleSteering | ProbeNavigation) -> Action:
    """Do anything, evenly, drawn by the environment's own generator."""
    return env.np_random.uniform(-1, 1, len(env.rates)).astype(np.float32)


def solved(env: NeedleSteering | ProbeNavigation, policy: Policy, seeds: Iterable[int]) -> list[dict[str, Any]]:
    """Return what the last step of an episode said, of each seed, with its number of ``steps`` and its ``seed``."""
    found = []
    for seed in seeds:
        env.reset(seed=seed)
        steps, ended = 0, False
        info: dict[str, Any] = {}
        while not ended:
            _, _, done, late, info = env.step(policy(env))
            steps, ended = steps + 1, done or late
        found.append(info | {"seed": seed, "steps": steps})
    return found


def _towards(env: NeedleSteering, goal: Array) -> Action:
    episode = env.episode
    now, skin = episode.command.needle, episode.scene.frame
    wanted = skin.needle_command(Needle(episode.frame.entry, goal))
    turn, swing = wanted.angle - now.angle, wanted.swing - now.swing
    aimed = now.depth > 0 or max(abs(turn), abs(swing)) < _AIMED_DEG
    return _action(env, [wanted.depth - now.depth if aimed else 0.0, turn, swing])


def _action(env: NeedleSteering | ProbeNavigation, by: list[float]) -> Action:
    """The action that comes as near to moving by so much as a step can."""
    return np.clip(np.array(by) / env.step_sizes, -1, 1).astype(np.float32)
