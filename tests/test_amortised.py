"""Table I's seven parameters by site, direction and depth."""

import numpy as np
import pytest

import sonospline as ss
from sonospline.mechanics import AmortisedParameters, NeedleTissueModel
from sonospline.mechanics.amortised import TUNED, features, multiplied, second_order
from sonospline.study import amortising
from sonospline.study.insertions import PlannedInsertion
from sonospline.study.metrics import displacement_errors

PLAN = PlannedInsertion("oblique", (0, 0.3, 0.45), (0.5, 0.6, 0.4))
MIRRORED = PlannedInsertion("mirrored", (0, 0.7, 0.45), (0.5, 0.4, 0.4))


def block(face="x-", side=1.0):
    return ss.Tissue(ss.Grid(shape=(9, 9, 9), spacing=side / 8), entry_face=face)


def test_a_block_that_is_turned_or_mirrored_is_the_same():
    expected = features(block(), PLAN.on(block()))
    for face in ss.FACES:
        for plan in (PLAN, MIRRORED):
            assert features(block(face), plan.on(block(face))) == pytest.approx(expected, abs=1e-12)
    length = np.linalg.norm([0.5, 0.3, -0.05])
    assert expected == pytest.approx([length, 0.5 / length, 0.3, 0.4, 0.425])


def test_parameters_are_lengths():
    shipped = AmortisedParameters.shipped()
    small, large = (shipped.model(block(side=side), PLAN.on(block(side=side))) for side in (1.0, 100.0))
    assert large == small.scaled(100.0)
    assert small.shaft_radius == pytest.approx(3 * small.shaft_decay)


def test_values_come_back_from_json():
    shipped = AmortisedParameters.shipped()
    again = AmortisedParameters.of(shipped.values())
    assert again.model(block(), PLAN.on(block())) == shipped.model(block(), PLAN.on(block()))


def test_products_to_second_order():
    assert second_order([2, 3]).tolist() == [1, 2, 3, 4, 6, 9]


def test_what_is_multiplied_is_multiplied_within_bounds():
    tuned = NeedleTissueModel.tuned()
    assert multiplied(tuned, np.zeros(7)) == tuned
    far = multiplied(tuned, np.full(7, 9.0))
    assert all(getattr(far, name) == pytest.approx(np.exp(1.5) * getattr(tuned, name)) for name in TUNED)


@pytest.mark.parametrize(
    ("made", "line"),
    [
        (lambda a: a.model(block(), "needle"), "needle = 'needle' is none; give a Needle"),
        (lambda a: a.model(block(), ss.Needle((0, 0.5, 0.5), (2, 0.5, 0.5))), "tip = .* lies outside the tissue"),
        (lambda a: AmortisedParameters(a.constant, a.mean, a.scale, a.weights[:3]), "weights has shape .*; give"),
        (
            lambda a: AmortisedParameters(a.constant, a.mean * np.nan, a.scale, a.weights),
            "mean has shape .* not finite",
        ),
    ],
)
def test_bad_input_is_one_line(made, line):
    with pytest.raises(ValueError, match=line) as caught:
        made(AmortisedParameters.shipped())
    assert "\n" not in str(caught.value)


def test_drawn_insertions_enter_every_face_and_depend_on_the_seed_alone():
    few, many = (amortising.drawn_insertions(count, seed=3, side=9) for count in (4, 12))
    assert [one.plan for one in few] == [one.plan for one in many[:4]]
    assert {one.tissue.entry_face for one in many} == set(ss.FACES)
    assert max(one.plan.angle for one in many) <= amortising.STEEPEST_DEG
    assert amortising.drawn_insertions(1, seed=4, side=9)[0].plan.target != few[0].plan.target


@pytest.mark.slow
def test_learning_undoes_a_bad_constant_and_tells_sites_apart():
    """Fields that the spline itself makes, with parameters that depend on the site: the learner finds them."""
    samples, tuned = amortising.drawn_insertions(12, seed=5, side=9), NeedleTissueModel.tuned()

    def truth(sample):
        return multiplied(tuned, [sample.needle.depth, 0, 0, 0, -sample.needle.depth, 0, 0])

    for sample in samples:
        vars(sample)["expected"] = np.float32(sample.field(truth(sample)))
    found = amortising.learn(samples, ridge=1e-6, rounds=3)
    errors = amortising.compare(samples, {"tuned": lambda tissue, needle: tuned, "learnt": found.model})
    assert errors["learnt"].relative < 0.2 * errors["tuned"].relative


def test_a_fit_to_one_insertion_is_better_than_its_start():
    sample, tuned = amortising.drawn_insertions(1, seed=6, side=9)[0], NeedleTissueModel.tuned()
    before = displacement_errors(sample.field(tuned), sample.expected).relative
    alone = amortising.fitted_alone(sample, tuned, evaluations=60)
    assert sample.errors(alone).relative < before


@pytest.mark.slow
def test_on_insertions_that_none_has_seen_the_shipped_ones_are_a_little_nearer():
    samples = amortising.drawn_insertions(24, seed=amortising.HELD_OUT_SEED)
    tuned = NeedleTissueModel.tuned()
    sets = {"tuned": lambda tissue, needle: tuned, "amortised": AmortisedParameters.shipped().model}
    errors = amortising.compare(samples, sets)
    assert 0.9 < errors["amortised"].relative / errors["tuned"].relative < 1
