"""Eight needles that are steered in one process, a learner's way: all of them step, then all of them again.

Claim: 200 steps a second in all, from state observations, the scripted hand at work; a second of the clock, and of one
processor's time where others use the machine, too.

    python benchmarks/eight_environments_take_two_hundred_steps_a_second.py [ROUNDS]

Ends with 1 where there are fewer by the processor's time.
"""

import os
import sys
import time

os.environ.setdefault("SONOSPLINE_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import gymnasium
import numpy as np

from sonospline.envs import IDS, steer

LEAST, ENVS = 200.0, 8
rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 120
name = next(iter(IDS))
vector = gymnasium.make_vec(name, num_envs=ENVS, vectorization_mode="sync")
vector.reset(seed=0)
hands = [env.unwrapped for env in vector.envs]


def turn():
    vector.step(np.stack([steer(env) for env in hands]))


for _ in range(25):  # needles aimed and in
    turn()
clock, processor = time.perf_counter(), time.process_time()
for _ in range(rounds):
    turn()
clock, processor = time.perf_counter() - clock, time.process_time() - processor
steps = rounds * ENVS
print(f"{name}: found {steps / clock:.0f} steps a second by the clock, {steps / processor:.0f} of a processor's time,")
print(f"at least {LEAST:.0f}; {1e3 * processor / steps:.2f} ms of a processor a step")
sys.exit(steps / processor < LEAST)
