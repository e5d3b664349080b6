"""A needle in a phantom prostate: a slow hand takes the gland along, a fast one goes through."""

import pytest

from sonospline.study.prostate import prostate_model, pushed_at


@pytest.mark.slow
def test_a_slow_hand_takes_a_prostate_along_by_10_to_20_mm_and_a_fast_one_by_1():
    """Published: up to 20 mm by hand, 1 mm with a pneumatic device."""
    model = prostate_model()
    slow, fast = pushed_at(model, 2.0, step_mm=2.0), pushed_at(model, 1000.0, step_mm=2.0)
    assert 10 <= slow.moved_mm <= 20
    assert 0.5 <= fast.moved_mm <= 2
    assert slow.force_n > 2 * fast.force_n
    assert slow.punctured_mm > fast.punctured_mm + 20  # it dents so much farther
