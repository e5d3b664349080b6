"""Scripted hands in the environments: one that looks at every step, one that follows a plan, and chance.

Claim: of 200 held-out episodes the hand that looks solves more than 95 %, chance less than 5 %; a plan made before any
tissue moved misses most.

    python benchmarks/a_hand_that_looks_solves_what_chance_does_not.py [EPISODES]

Ends with 1 where a share is on the wrong side.
"""

import sys
from statistics import median

from sonospline.envs import NeedleSteering, ProbeNavigation, at_random, navigate, solved, steer, steer_without_looking

HELD_OUT, KNOWS, BLIND, CHANCE = 1_000_000, 0.95, 0.5, 0.05
MOST = {steer_without_looking: BLIND, at_random: CHANCE}
HANDS = ((NeedleSteering, steer, steer_without_looking, at_random), (ProbeNavigation, navigate, at_random))

episodes = int(sys.argv[1]) if len(sys.argv) > 1 else 200
kept = True
for kind, *hands in HANDS:
    env = kind()
    for hand in hands:
        last = solved(env, hand, range(HELD_OUT, HELD_OUT + episodes))
        share = sum(one["is_success"] for one in last) / episodes
        moved = median(one["target_moved_mm"] for one in last)
        kept &= share < MOST[hand] if hand in MOST else share > KNOWS
        wanted = f"at most {MOST[hand]:.0%}" if hand in MOST else f"at least {KNOWS:.0%}"
        named = f"{kind.__name__:16s} {hand.__name__:22s}"
        print(f"{named} found {share:.1%}, {wanted}; the target has moved by {moved:.1f} mm", flush=True)
sys.exit(not kept)
