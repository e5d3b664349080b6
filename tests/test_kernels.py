"""Kernels: values, scaling, and the sign that smoothing relies on."""

import numpy as np
import pytest
from scipy.linalg import null_space

import sonospline as ss

KERNELS = [ss.Biharmonic(), ss.Triharmonic()]

pytestmark = pytest.mark.usefixtures("backend")


@pytest.mark.parametrize(("kernel", "value"), [(ss.Biharmonic(), 13.0), (ss.Triharmonic(), 2197.0)])
def test_value_at_a_distance_of_thirteen(kernel, value):
    matrix = kernel.matrix(np.array([[1.0, 1.0, 1.0]]), np.array([[4.0, 5.0, 13.0], [1.0, 1.0, 1.0]]))
    np.testing.assert_allclose(matrix, [[value, 0.0]], rtol=1e-14)


@pytest.mark.parametrize("kernel", KERNELS, ids=repr)
def test_homogeneity_is_the_power_of_the_unit(kernel, random_landmarks):
    one, ten = (kernel.matrix(s * random_landmarks, s * random_landmarks) for s in (1.0, 10.0))
    np.testing.assert_allclose(ten, one * 10.0**kernel.homogeneity, rtol=1e-12)


@pytest.mark.parametrize("kernel", KERNELS, ids=repr)
def test_sign_times_kernel_is_positive_definite_beside_the_affine_part(kernel, random_landmarks):
    affine = np.column_stack([np.ones(len(random_landmarks)), random_landmarks])
    rest = null_space(affine.T)
    matrix = rest.T @ kernel.matrix(random_landmarks, random_landmarks) @ rest
    assert np.linalg.eigvalsh(kernel.sign * matrix).min() > 0
