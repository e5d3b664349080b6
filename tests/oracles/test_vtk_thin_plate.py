"""The bare spline against VTK's thin-plate transform with the basis r."""

import numpy as np
import pytest

import sonospline as ss

vtk_points = pytest.importorskip("vtkmodules.vtkCommonCore", reason="needs the extra 'io' (vtk)")
vtk_transforms = pytest.importorskip("vtkmodules.vtkCommonTransforms", reason="needs the extra 'io' (vtk)")

pytestmark = pytest.mark.usefixtures("backend")


def vtk_transform(source, target):
    def as_vtk(array):
        points = vtk_points.vtkPoints()
        points.SetDataTypeToDouble()
        for row in array:
            points.InsertNextPoint(*row)
        return points

    transform = vtk_transforms.vtkThinPlateSplineTransform()
    transform.SetBasisToR()
    transform.SetSourceLandmarks(as_vtk(source))
    transform.SetTargetLandmarks(as_vtk(target))
    return lambda places: np.array([transform.TransformPoint(*place) for place in places])


@pytest.mark.parametrize("side", [1.0, 100.0])
def test_forward_map_is_vtks(random_landmarks, random_values, random_places, side):
    points, values, places = side * random_landmarks, side * random_values, side * random_places
    ours = ss.PolyharmonicSpline.fit(points, values).forward(places)
    theirs = vtk_transform(points, points + values)(places)
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9 * side)


def test_insertion_is_vtks_map_of_the_same_landmarks(a_deformed_field, random_places):
    centres = a_deformed_field.centres
    theirs = vtk_transform(centres, a_deformed_field.forward(centres))(random_places)
    np.testing.assert_allclose(a_deformed_field.forward(random_places), theirs, rtol=0, atol=1e-9)
