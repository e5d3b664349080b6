"""Environments for learning: Gymnasium's own check, the same seed the same episode, scripted hands, bad input."""

import numpy as np
import pytest
from msgspec.structs import replace

from sonospline.training import METRICS, Exercise

gymnasium = pytest.importorskip("gymnasium", reason="needs the extra 'envs'")

from gymnasium.utils.env_checker import check_env  # noqa: E402

from sonospline import envs  # noqa: E402
from sonospline.envs import Cost, NeedleSteering, ProbeNavigation  # noqa: E402

NODES = 1000
VESSEL = Exercise.shipped("vessel-in-plane")
PUSH = np.array([1.0, 0.3, -0.2], np.float32)


@pytest.fixture(scope="module")
def steering():
    return NeedleSteering(nodes=NODES)


@pytest.fixture(scope="module")
def navigation():
    return ProbeNavigation(nodes=NODES)


def walked(env, seed, actions):
    """Everything that an episode says, in bytes."""
    observation, info = env.reset(seed=seed)
    said = [observation.tobytes(), repr(info)]
    for action in actions:
        observation, reward, done, late, info = env.step(action)
        said += [observation.tobytes(), repr((reward, done, late, info))]
        if done or late:
            break
    return said


def _some_slow(names):
    """The first everyday, the others where there is time."""
    return [name if k == 0 else pytest.param(name, marks=pytest.mark.slow) for k, name in enumerate(names)]


@pytest.mark.parametrize("name", _some_slow(envs.IDS))
def test_gymnasium_finds_nothing_to_say(name, recwarn):
    check_env(gymnasium.make(name, nodes=NODES, render_mode="rgb_array" if "Pixels" in name else None).unwrapped)
    assert [str(warning.message) for warning in recwarn] == []


@pytest.mark.slow
@pytest.mark.parametrize("name", envs.IDS)
def test_stable_baselines_finds_nothing_to_say(name, recwarn):
    checker = pytest.importorskip("stable_baselines3.common.env_checker", reason="needs the extra 'learn'")
    checker.check_env(gymnasium.make(name, nodes=NODES).unwrapped)
    assert [str(warning.message) for warning in recwarn] == []


def test_the_same_seed_is_the_same_episode_whatever_came_before(steering):
    actions = np.random.default_rng(0).uniform(-1, 1, (12, 3))
    actions[:, 0] = np.abs(actions[:, 0])
    first = walked(steering, 5, actions)
    assert walked(steering, 6, actions) != first
    assert walked(steering, 5, actions) == first == walked(NeedleSteering(nodes=NODES), 5, actions)


def test_environments_of_one_process_keep_apart(steering):
    other = NeedleSteering(nodes=NODES)
    alone = walked(steering, 5, [PUSH] * 6)
    steering.reset(seed=5)
    other.reset(seed=9)
    for _ in range(6):
        said = steering.step(PUSH)[0].tobytes()
        other.step(-PUSH)
    assert said == alone[-2]


def test_episodes_differ_in_start_and_target(steering):
    seen = []
    for seed in (0, 1, None, None):  # without a seed the next one of the last
        steering.reset(seed=seed)
        frame = steering.episode.frame
        needle = frame.command.needle
        seen.append((*frame.target_rest, needle.u, needle.v, needle.angle, needle.swing, frame.command.probe.rotate))
    assert all(len(set(values)) == 4 for values in zip(*seen, strict=True))


def test_observations_are_what_they_are_called(steering):
    """By vectors in the world, which the environment does not use."""
    steering.reset(seed=2)
    for action in [(0, 1, -1)] * 3 + [(1, 0.4, 0.2)] * 12:
        observation = steering.step(action)[0]
    seen = dict(zip(steering.numbers, observation.astype(float), strict=True))
    frame = steering.episode.frame
    missing = 20 * np.array([seen["target ahead"], seen["target up"], seen["target aside"]])
    assert np.linalg.norm(missing) == pytest.approx(frame.readouts.tip_to_target, rel=1e-5)
    assert missing[0] == pytest.approx((frame.target_now - frame.tip) @ frame.needle.direction, rel=1e-5)
    apart = 20 * np.array([seen[f"target {way}"] - seen[f"rest {way}"] for way in ("ahead", "up", "aside")])
    assert np.linalg.norm(apart) == pytest.approx(frame.readouts.moved, rel=1e-3)
    assert 50 * seen["depth"] == pytest.approx(frame.needle.depth, rel=1e-5)
    assert seen["needle deep"] == pytest.approx(frame.needle.direction[2], rel=1e-5)
    assert seen["time left"] == pytest.approx(1 - 15 / 200)
    turned = steering.step((0, 1, 0))[0][1]
    assert turned < observation[1], "turning up brings a target that is up nearer to the axis"


def test_rewards_are_bounded_and_sum_to_what_was_gained(steering):
    steering.reset(seed=4)
    far, rewards, done = steering._far(), [], False
    while not done:
        _, reward, done, late, info = steering.step(envs.steer(steering))
        rewards.append(reward)
        assert not late
    worth = envs.score(info["metrics"], steering.costs)
    assert info["is_success"] and 0 < worth < 1
    assert sum(rewards) == pytest.approx(far - steering._far() + worth)
    assert min(rewards) >= -1 and max(rewards) <= 2 and sum(rewards) <= 2
    assert set(info["metrics"]) == set(METRICS) and info["metrics"]["final_error_mm"] <= 1


def test_a_needle_that_only_touches_its_target_has_not_solved_it(steering):
    """One that goes on through it: the goal is held for three steps."""
    steering.reset(seed=4)
    done = nearest = 1000.0
    done = False
    while not done:
        action = envs.steer(steering)
        frame = steering.episode.frame
        through = frame.needle is not None and frame.readouts.tip_to_target < 3
        if through or nearest < 3:
            action[0] = 1.0
        _, _, done, late, info = steering.step(action)
        nearest = min(nearest, info["distance_mm"])
        done = done or late
    assert nearest < 1.0 and not info["is_success"] and late


def test_time_ends_an_episode_and_it_takes_no_more_steps():
    env = NeedleSteering(nodes=NODES, limit_s=0.5)
    env.reset(seed=0)
    ends = [env.step(np.zeros(3))[2:4] for _ in range(5)]
    assert ends == [(False, False)] * 4 + [(False, True)]
    with pytest.raises(ValueError, match="the episode has ended; reset"):
        env.step(np.zeros(3))


def test_punctures_beyond_the_exercises_end_an_episode(steering):
    steering.reset(seed=0)
    done = False
    for push in [1.0, -1.0] * 4:
        if not done:
            _, _, done, late, info = steering.step((push, 0, 0))
    assert done and not late and not info["is_success"] and info["metrics"]["passes"] == 4


def test_a_probe_is_brought_over_needle_and_target(navigation):
    found = envs.solved(navigation, envs.navigate, range(4))
    assert all(one["is_success"] and one["steps"] < 40 for one in found)
    frame = navigation.episode.frame
    for place in (frame.target_now, frame.tip):
        away, half_slice = frame.out_of_plane(place)
        assert abs(away) <= half_slice
    assert frame.readouts.tip_to_target > 5, "the needle is part of the way in"
    assert frame.readouts.moved > 0.1, "the needle has moved the target"


def test_a_vector_of_environments_is_the_environments_one_by_one(steering):
    vector = gymnasium.make_vec(
        "sonospline/NeedleSteering-v0", num_envs=2, vectorization_mode="sync", nodes=NODES, limit_s=20
    )
    observations, _ = vector.reset(seed=[5, 6])
    for _ in range(3):
        observations, *_ = vector.step(np.stack([PUSH, PUSH]))
    alone = walked(steering, 6, [PUSH] * 3)
    assert observations[1].tobytes() == alone[-2]
    vector.close()


def test_pictures_are_observed_and_the_tissue_is_the_same(steering):
    env = NeedleSteering(observe="pixels", nodes=NODES)
    observation, _ = env.reset(seed=5)
    assert env.observation_space.contains(observation)
    before = observation["image"]
    observation, *_ = env.step(PUSH)
    assert observation["image"].shape == env.observation_space["image"].shape and observation["image"].std() > 10
    assert (observation["image"] != before).any(), "an observation is kept by its reader"
    steering.reset(seed=5)
    state = dict(zip(steering.numbers, steering.step(PUSH)[0], strict=True))
    assert observation["hand"].tolist() == [state[name] for name in env.by_hand]


def test_what_people_look_at_shows_target_and_needle():
    env = NeedleSteering(nodes=NODES, render_mode="rgb_array")
    env.reset(seed=5)
    for _ in range(12):
        env.step(envs.steer(env))
    picture = env.render().astype(int)
    coloured = np.ptp(picture, axis=2) > 60
    assert picture.shape[0] == 512 and 100 < coloured.sum() < 6000
    frame = env.episode.frame
    local = (frame.target_now - frame.probe_to_reference[:3, 3]) @ frame.probe_to_reference[:3, :3]
    left, right, top, bottom = frame.probe.footprint  # of the picture, mm
    column, row = (local[0] - left) / (right - left) * 389 - 0.5, (local[1] - top) / (bottom - top) * 512 - 0.5
    yellow = np.argwhere((picture[..., 0] > 200) & (picture[..., 2] < 110))
    assert np.abs(yellow.mean(axis=0) - (row, column)).max() < 2
    assert NeedleSteering(nodes=NODES).render() is None


@pytest.mark.parametrize(
    ("made", "line"),
    [
        (lambda: NeedleSteering("vessels"), "exercise = 'vessels' is not known; choose one of needle-steering, probe"),
        (lambda: NeedleSteering(7), "exercise = 7 is none; give a name, a .toml file or an Exercise"),
        (lambda: NeedleSteering(spread_mm=(0, 60, 0)), "target = .* outside"),
        (lambda: NeedleSteering(spread_mm=(0, -1, 0)), "spread_mm = .* is below zero"),
        (lambda: NeedleSteering(spread_mm=(1, 2)), "spread_mm = .* give three numbers"),
        (lambda: NeedleSteering(limit_s=-1), "limit_s = -1 is out of range"),
        (lambda: NeedleSteering(tolerance_mm=0), "tolerance_mm = 0 is out of range"),
        (lambda: ProbeNavigation(middle_mm=float("nan")), "middle_mm = nan is out of range"),
        (lambda: NeedleSteering(nodes=10), "nodes = 10 is too small; give at least 1000"),
        (lambda: NeedleSteering(observe="video"), "observe = 'video' is not known; choose one of state, pixels"),
        (lambda: NeedleSteering(render_mode="human"), "render_mode = 'human' is not known; choose one of rgb_array"),
        (lambda: NeedleSteering(costs={"speed": Cost(0.1, 1)}), "costs = 'speed' is not known; choose one of time_s"),
        (lambda: NeedleSteering(costs={"time_s": Cost(1.1, 1)}), "costs weigh 1.1 together; give weights of 1"),
        (lambda: Cost(0.1, 0), "worst = 0 is out of range"),
        (
            lambda: envs.World("needle-steering", spread_mm=(59, 0, 0)),
            r"target at \[119.0, 30.0, 24.0\] is out of reach",
        ),
        (
            lambda: NeedleSteering(replace(Exercise.shipped("vessel-in-plane"), target="duct")),
            "target = 'duct' of exercise",
        ),
    ],
)
def test_bad_input_is_one_line(made, line):
    with pytest.raises(ValueError, match=line) as caught:
        made()
    assert "\n" not in str(caught.value)


def test_a_scene_that_is_not_known_is_one_line(tmp_path):
    text = (envs.world.FOLDER / "needle-steering.toml").read_text().replace("soft-gel.toml", "liver.toml")
    file = tmp_path / "mine.toml"
    file.write_text(text)
    with pytest.raises(ValueError, match=r"scene = .*liver\.toml") as caught:
        NeedleSteering(file)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("action", "line"),
    [
        ((0, 0), r"action has shape \(2,\); give 3 numbers: push, angle, swing"),
        ((0, float("nan"), 0), "action = .* contains NaN or infinity; give numbers from -1 to 1"),
        ("push", "action = 'push' is not numeric; give 3 numbers"),
    ],
)
def test_an_action_that_is_refused_changes_nothing(steering, action, line):
    steering.reset(seed=1)
    frame = steering.episode.frame
    with pytest.raises(ValueError, match=line):
        steering.step(action)
    assert steering.episode.frame is frame


def test_options_of_a_reset(steering):
    steering.reset(seed=1, options={"target_mm": (60, 30, 20)})
    assert steering.episode.frame.target_rest.tolist() == [60, 30, 20]
    with pytest.raises(ValueError, match="options = 'target' is not known; choose one of target_mm"):
        steering.reset(options={"target": (60, 30, 20)})
    with pytest.raises(ValueError, match=r"target = .* outside"):
        steering.reset(options={"target_mm": (60, 30, 200)})
    with pytest.raises(ValueError, match=r"out of reach from u = -40, v = -8 mm: needle\.depth = 1.* give 0 to 90"):
        steering.reset(options={"target_mm": (119, 30, 69)})


@pytest.mark.slow
def test_who_looks_solves_nearly_all_and_chance_nearly_none(steering, navigation):
    """Fewer than the benchmark's, on the smallest grid."""
    seeds = range(500, 508)
    for env, hand in ((steering, envs.steer), (navigation, envs.navigate)):
        assert sum(one["is_success"] for one in envs.solved(env, hand, seeds)) >= 7
        assert sum(one["is_success"] for one in envs.solved(env, envs.at_random, seeds)) <= 1
    assert sum(one["is_success"] for one in envs.solved(steering, envs.steer_without_looking, seeds)) <= 1


@pytest.mark.slow
@pytest.mark.parametrize("exercise", ["lesion-biopsy", "calyx-guided"])
def test_the_trainers_exercises_are_environments_too(exercise):
    env = NeedleSteering(exercise, spread_mm=(0, 0, 0), tolerance_mm=2.0, limit_s=40, nodes=NODES)
    info = envs.solved(env, envs.steer, [1])[0]
    assert info["is_success"]
