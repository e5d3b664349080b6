"""Every model of tissue keeps the contract: a step is a function of its arguments, and says what it cannot do."""

import copy
import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import sonospline as ss
from sonospline import models
from sonospline.models import CapabilityError

SIDE = 100.0
BUILT_IN = ("paper", "kelvinlet", "elastic")
SMALL = {"elastic": {"solver_nodes": 9**3}}


def tissue(nodes=13):
    return ss.Tissue(ss.Grid(shape=(nodes,) * 3, spacing=SIDE / (nodes - 1)))


def make(name, nodes=13, **options):
    return models.make(name, tissue(nodes), **SMALL.get(name, {}) | options)


def at(depth, *, offset=0.0):
    return {"needle": ss.Needle((0, 45 + offset, 50), (depth, 55 + offset, 50))}


@pytest.fixture(params=BUILT_IN)
def model(request):
    return make(request.param)


def follow(model, state, depths):
    """The responses of a needle pushed through depths, each from the state before."""
    found = []
    for depth in depths:
        found.append(model.step(state, at(depth)))
        state = found[-1].state
    return found


def values(response):
    return response.field.on_grid()


def test_the_table_offers_what_the_models_are(model):
    spec = models.spec(model.name)
    assert spec.capabilities == model.capabilities
    assert model.title == spec.title
    assert spec.summary


def test_a_step_depends_on_its_arguments_alone(model):
    first = follow(model, model.rest, (20.0, 40.0, 60.0))
    kept = pickle.dumps(first[0].state)
    follow(model, model.rest, (70.0, 10.0))  # whatever else the model is asked
    model.step(first[1].state, at(30.0, offset=7.0))
    again = follow(model, model.rest, (20.0, 40.0, 60.0))
    fresh = follow(make(model.name), model.rest, (20.0, 40.0, 60.0))
    for then, now, other in zip(first, again, fresh, strict=True):
        assert then.state == now.state == other.state
        assert np.array_equal(values(then), values(now))
        assert np.array_equal(values(then), values(other))
    assert pickle.loads(kept) == copy.deepcopy(first[0].state)


def test_states_compare_by_value_and_say_what_they_are(model):
    one, two = follow(model, model.rest, (20.0, 40.0))
    assert one.state != two.state
    assert one.state == copy.deepcopy(one.state) == pickle.loads(pickle.dumps(one.state))
    assert hash(one.state) == hash(pickle.loads(pickle.dumps(one.state)))
    assert model.step(two.state).state == model.rest == make(model.name).rest
    assert model.name in repr(one.state) and len(repr(one)) < 400


def test_a_model_is_shared_by_threads(model):
    states = [response.state for response in follow(model, model.rest, (20.0, 40.0))]
    asked = [(state, at(depth, offset=offset)) for state in states for depth in (30.0, 60.0) for offset in (0.0, 5.0)]
    alone = [values(model.step(*arguments)) for arguments in asked]
    with ThreadPoolExecutor(4) as threads:
        together = list(threads.map(lambda arguments: values(model.step(*arguments)), 3 * asked))
    for now, then in zip(together, 3 * alone, strict=True):
        assert np.array_equal(now, then)


def test_a_state_of_another_model_or_grid_is_refused(model):
    for other in (make("kelvinlet" if model.name == "paper" else "paper"), make(model.name, nodes=11)):
        with pytest.raises(ValueError, match=r"state is of model .*; start from this model's rest"):
            model.step(other.rest, at(20.0))
    alike = ss.Tissue(tissue().grid, entry_face="y+")
    other = models.make(model.name, alike, **SMALL.get(model.name, {}))
    with pytest.raises(ValueError, match="another box or other options"):
        model.step(other.rest, at(20.0))
    with pytest.raises(ValueError, match=r"state = None is not a State; give the model's rest"):
        model.step(None, at(20.0))


@pytest.mark.parametrize("dt", [-0.1, np.nan, np.inf])
def test_a_dt_below_zero_or_not_finite_is_refused(model, dt):
    with pytest.raises(ValueError, match=r"dt = .* out of range; give a finite number at or above zero"):
        model.step(model.rest, at(20.0), dt)


def test_needles_need_names_of_their_own(model):
    (needle,) = at(20.0).values()
    with pytest.raises(ValueError, match="needles has two named 'a'; give each a name of its own"):
        model.step(model.rest, [("a", needle), ("a", needle)])
    with pytest.raises(ValueError, match=r'has no name; give \{"needle": needle\}'):
        model.step(model.rest, needle)
    with pytest.raises(ValueError, match=r"needles has 'a': 3; give"):
        model.step(model.rest, {"a": 3})


def test_a_model_of_one_needle_says_which_take_two(model):
    two = {"a": at(20.0)["needle"], "b": at(30.0, offset=10.0)["needle"]}
    if "several needles" in model.capabilities:
        turned = dict(reversed(two.items()))
        assert model.step(model.rest, two).state == model.step(model.rest, turned).state
        return
    with pytest.raises(CapabilityError, match=r"several needles \(2 are given\); use .*'elastic'"):
        model.step(model.rest, two)


def test_a_model_without_forces_says_which_know_them(model):
    forces = model.step(model.rest, at(20.0)).forces
    if "forces" in model.capabilities:
        assert set(forces) == {"needle"}
        return
    assert len(forces) == 0 and "needle" not in forces
    with pytest.raises(CapabilityError, match="forces; use model = 'elastic'"):
        forces["needle"]
