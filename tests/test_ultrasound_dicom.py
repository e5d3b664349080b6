"""Ultrasound DICOM: what is read, and what is not trusted."""

import copy

import numpy as np
import pytest

from sonospline.ultrasound import read_dicom


def real_dicom(name):
    pydicom = pytest.importorskip("pydicom", reason="needs the extra 'dicom'")
    path = pydicom.data.get_testdata_file(name, download=False)
    if path is None:
        pytest.skip(f"this pydicom ships no {name}")
    return path


@pytest.fixture
def a_calibrated_file(tmp_path):
    """A real frame of the pydicom wheel, saved with a region that fits it."""
    pydicom = pytest.importorskip("pydicom", reason="needs the extra 'dicom'")
    dataset = pydicom.dcmread(real_dicom("examples_rgb_color.dcm"))
    region = pydicom.Dataset()
    region.RegionSpatialFormat = region.RegionDataType = 1
    region.RegionLocationMinX0, region.RegionLocationMinY0 = 40, 15
    region.RegionLocationMaxX1, region.RegionLocationMaxY1 = 299, 209
    region.PhysicalUnitsXDirection = region.PhysicalUnitsYDirection = 3
    region.PhysicalDeltaX, region.PhysicalDeltaY = 0.1, 0.05
    doppler = copy.deepcopy(region)
    doppler.RegionDataType, doppler.PhysicalUnitsXDirection = 3, 4
    dataset.SequenceOfUltrasoundRegions = [doppler, region]
    dataset.save_as(tmp_path / "calibrated.dcm")
    return tmp_path / "calibrated.dcm"


def test_a_calibrated_file_is_read_with_its_regions(a_calibrated_file):
    clip = read_dicom(a_calibrated_file)
    assert len(clip.regions) == 1  # the Doppler region is no image of tissue
    frame = clip.frame(image_to_reference=np.eye(4))
    assert frame.plane.spacing_mm == pytest.approx((1.0, 0.5))
    assert np.array_equal(frame.pixels, clip.frames[0, 15:210, 40:300])
    with pytest.raises(ValueError, match="region = 1"):
        clip.frame(image_to_reference=np.eye(4), region=1)
    with pytest.raises(ValueError, match="1 frames"):
        clip.frame(1, image_to_reference=np.eye(4))


@pytest.mark.parametrize(("name", "frames"), [("examples_ybr_color.dcm", 30), ("examples_palette.dcm", 1)])
def test_a_file_resized_after_its_calibration_is_not_trusted(name, frames):
    """Both of pydicom's calibrated files: one at half its size, where 0.51 mm would be 1.02; one cut off below."""
    clip = read_dicom(real_dicom(name))
    assert len(clip.frames) == frames
    assert clip.frames.std() > 5
    assert clip.regions
    with pytest.raises(ValueError, match=r"does not fit the .* frame.*give spacing_mm"):
        clip.frame(image_to_reference=np.eye(4))
    frame = clip.frame(frames - 1, image_to_reference=np.eye(4), spacing_mm=1.02)
    assert frame.plane.shape == clip.frames.shape[1:]


def test_an_uncalibrated_clip_is_refused_unless_a_spacing_is_given():
    clip = read_dicom(real_dicom("examples_rgb_color.dcm"))
    with pytest.raises(ValueError, match="spacing_mm"):
        clip.frame(image_to_reference=np.eye(4))
    assert clip.frame(image_to_reference=np.eye(4), spacing_mm=0.2).plane.spacing_mm == (0.2, 0.2)


def test_what_is_no_ultrasound_dicom_is_refused(tmp_path):
    with pytest.raises(ValueError, match="does not exist"):
        read_dicom(tmp_path / "none.dcm")
    ct = real_dicom("CT_small.dcm")
    with pytest.raises(ValueError, match="modality CT"):
        read_dicom(ct)
    (tmp_path / "text.dcm").write_text("hello")
    with pytest.raises(ValueError, match="cannot be read"):
        read_dicom(tmp_path / "text.dcm")
