"""Stable-Baselines3's SAC learns `sonospline/ProbeNavigation-v0` from nothing, and is judged on episodes it never saw.

Claim: after 10,000 steps, minutes of one processor, it solves at least 95 % of 200 held-out episodes.

    python benchmarks/a_learner_finds_the_plane_in_minutes.py [--seed N] [--steps N] [--judged N] [--out FOLDER]

It learns on coarse tissue, in episodes cut short; it is judged on the environment as registered. `--out` takes the
learning curve as numbers, and a picture of all curves that are there. Needs the extra `learn` (PyTorch's CPU build is
enough). Ends with 1 where fewer are solved.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np
import torch
from stable_baselines3 import SAC

from sonospline.envs import ProbeNavigation, solved

CLAIM, HELD_OUT, STEPS, EVERY, GLANCE = 0.95, 1_000_000, 10_000, 1000, 20
EASIER = {"nodes": 1000, "limit_s": 8.0}


def learner_of(seed):
    """Chance is worth little from the start, for a whole episode's rewards are; the goal is some ten steps away."""
    return SAC(
        "MlpPolicy", ProbeNavigation(**EASIER), seed=seed, gamma=0.9, learning_rate=1e-3, ent_coef="auto_0.005",
        learning_starts=500, policy_kwargs={"net_arch": [64, 64]}, device="cpu",
    )  # fmt: skip


def judged(env, learner, seeds):
    """Share of episodes that are solved, and how many steps those took, in the middle."""

    def policy(env):
        return learner.predict(env.observation, deterministic=True)[0]

    last = solved(env, policy, seeds)
    won = [one["steps"] for one in last if one["is_success"]]
    return len(won) / len(last), float(np.median(won)) if won else None


def learnt(seed, steps, episodes):
    """Learn; what is found, the curve too: `minutes` are one processor's, judging left out."""
    learner, glance = learner_of(seed), ProbeNavigation(**EASIER)
    busy, done, curve = 0.0, 0, []
    while done < steps:
        began = time.process_time()
        learner.learn(min(EVERY, steps - done), reset_num_timesteps=done == 0)
        busy, done = busy + time.process_time() - began, learner.num_timesteps
        share, _ = judged(glance, learner, range(HELD_OUT - GLANCE, HELD_OUT))
        curve.append({"steps": done, "minutes": busy / 60, "solved": share})
        print(f"{done:6d} steps, {busy / 60:4.1f} min: {share:4.0%} of {GLANCE} episodes solved", flush=True)
    share, middle = judged(ProbeNavigation(), learner, range(HELD_OUT, HELD_OUT + episodes))
    return {
        "seed": seed, "steps": done, "minutes": busy / 60, "solved": share, "episodes": episodes,
        "steps_of_an_episode": middle, "curve": curve,
    }  # fmt: skip


def draw(found, path):
    """The curves, as the documentation shows them."""
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(6, 3), layout="constrained")
    for one in found:
        steps = [0, *(row["steps"] / 1000 for row in one["curve"])]
        share = [0, *(100 * row["solved"] for row in one["curve"])]
        axes.plot(steps, share, marker="o", markersize=3, alpha=0.8, label=f"seed {one['seed']}")
    axes.set(xlabel="thousand steps", ylabel=f"solved of {GLANCE} held-out episodes, %", ylim=(-3, 103))
    axes.legend(loc="lower right")
    axes.grid(alpha=0.3)
    figure.savefig(path, dpi=130)
    plt.close(figure)


def main(words=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0, help="of the learner and of its episodes (0)")
    parser.add_argument("--steps", type=int, default=STEPS, help=f"to learn from ({STEPS})")
    parser.add_argument("--judged", type=int, default=200, help="held-out episodes (200)")
    parser.add_argument("--out", type=Path, help="folder for numbers and picture")
    args = parser.parse_args(words)
    if min(args.steps, args.judged) < 1:
        parser.error(f"--steps {args.steps} and --judged {args.judged}: give at least 1 of each")
    torch.set_num_threads(1)
    found = learnt(args.seed, args.steps, args.judged)
    print(
        f"{found['solved']:.1%} of {args.judged} held-out episodes solved, at least {CLAIM:.0%}, "
        f"after {found['steps']} steps in {found['minutes']:.1f} min of one processor"
    )
    if args.out:
        args.out.mkdir(parents=True, exist_ok=True)
        (args.out / f"learning-{args.seed}.json").write_text(json.dumps(found, indent=1) + "\n")
        all_there = [json.loads(path.read_text()) for path in sorted(args.out.glob("learning-*.json"))]
        draw(all_there, args.out / "learning.png")
    return 0 if found["solved"] >= CLAIM else 1


if __name__ == "__main__":
    raise SystemExit(main())
