"""DICOM files as scanners write them, made by pydicom: slices one by one, many in a file, segments."""

import warnings

import numpy as np
import pydicom
from pydicom.dataset import Dataset, FileDataset, FileMetaDataset
from pydicom.uid import ExplicitVRLittleEndian, generate_uid

CT, ENHANCED_CT, SEGMENTATION = (
    "1.2.840.10008.5.1.4.1.1.2", "1.2.840.10008.5.1.4.1.1.2.1", "1.2.840.10008.5.1.4.1.1.66.4"
)  # fmt: skip


def places(count, axes, origin=(11.0, -7.0, 23.0), step=2.5, tilt=0.0):
    """Where slices are: along the normal of ``axes`` (2, 3), each ``tilt`` mm further down than the one before."""
    across, down = np.asarray(axes, float)
    way = step * np.cross(across, down) + tilt * down
    return [np.array(origin) + number * way for number in range(count)]


def item(**fields):
    made = Dataset()
    for name, value in fields.items():
        setattr(made, name, value)
    return made


def dataset(kind, pixels, *, uid, description, bits=16):
    """A file without places."""
    meta = FileMetaDataset()
    meta.MediaStorageSOPClassUID, meta.TransferSyntaxUID = kind, ExplicitVRLittleEndian
    meta.MediaStorageSOPInstanceUID = generate_uid()
    made = FileDataset(None, {}, file_meta=meta, preamble=b"\0" * 128)
    made.SOPClassUID, made.SOPInstanceUID = kind, meta.MediaStorageSOPInstanceUID
    made.SeriesInstanceUID, made.StudyInstanceUID = uid, generate_uid(entropy_srcs=["study"])
    made.SeriesDescription, made.Modality, made.SeriesNumber = description, "CT", 3
    made.Rows, made.Columns = pixels.shape[-2:]
    made.SamplesPerPixel, made.PhotometricInterpretation = 1, "MONOCHROME2"
    made.BitsAllocated = made.BitsStored = bits
    made.HighBit, made.PixelRepresentation = bits - 1, 0
    packed = np.packbits(pixels.astype(np.uint8).ravel(), bitorder="little") if bits == 1 else pixels.astype("<u2")
    data = packed.tobytes()
    made.add_new("PixelData", "OB" if bits == 1 else "OW", data + b"\0" * (len(data) % 2))
    return made


def numbers(values):
    """As DICOM writes them: 16 characters at most."""
    return [float(f"{value:.10g}") for value in np.ravel(values)]


def write_series(folder, pixels, positions, axes, *, spacing=(0.8, 1.4), uid=None, description="thorax", first=0):
    """Slices in files whose names say nothing of their order; stored values are 1024 more than what they mean."""
    folder.mkdir(exist_ok=True)
    uid = uid or generate_uid()
    for number, (image, position) in enumerate(zip(pixels, positions, strict=True)):
        made = dataset(CT, image, uid=uid, description=description)
        made.ImagePositionPatient, made.ImageOrientationPatient = numbers(position), numbers(axes)
        made.PixelSpacing, made.SliceThickness = list(spacing), 5.0
        made.RescaleSlope, made.RescaleIntercept = 1, -1024
        made.InstanceNumber = number + 1
        save(made, folder / f"IM{(7 * number) % 101 + 200 * first:05d}.dcm")
    return uid


def write_enhanced(path, pixels, positions, axes, *, spacing=(0.8, 1.4), order=None):
    """All slices in one file, in any order; the pixels' size is shared, each frame has its place."""
    order = list(range(len(pixels))) if order is None else list(order)
    made = dataset(ENHANCED_CT, np.stack([pixels[k] for k in order]), uid=generate_uid(), description="enhanced")
    made.NumberOfFrames = len(order)
    made.SharedFunctionalGroupsSequence = [
        item(
            PixelMeasuresSequence=[item(PixelSpacing=list(spacing), SliceThickness=9.0)],
            PlaneOrientationSequence=[item(ImageOrientationPatient=numbers(axes))],
            PixelValueTransformationSequence=[item(RescaleSlope=1, RescaleIntercept=-1024)],
        )
    ]
    made.PerFrameFunctionalGroupsSequence = [
        item(PlanePositionSequence=[item(ImagePositionPatient=numbers(positions[k]))]) for k in order
    ]
    save(made, path)


def write_segments(path, masks, positions, axes, names, *, spacing=(0.8, 1.4), **measures):
    """Binary segments; slices where one is empty are left out, as programs do it."""
    frames = [(n, k) for n, mask in enumerate(masks) for k in range(len(mask)) if mask[k].any()]
    made = dataset(
        SEGMENTATION, np.stack([masks[n][k] for n, k in frames]), uid=generate_uid(), description="organs", bits=1
    )
    made.Modality, made.SegmentationType, made.NumberOfFrames = "SEG", "BINARY", len(frames)
    made.SegmentSequence = [item(SegmentNumber=n + 1, SegmentLabel=name) for n, name in enumerate(names)]
    made.SharedFunctionalGroupsSequence = [
        item(
            PixelMeasuresSequence=[item(PixelSpacing=list(spacing), SliceThickness=2.5, **measures)],
            PlaneOrientationSequence=[item(ImageOrientationPatient=numbers(axes))],
        )
    ]
    made.PerFrameFunctionalGroupsSequence = [
        item(
            PlanePositionSequence=[item(ImagePositionPatient=numbers(positions[k]))],
            SegmentIdentificationSequence=[item(ReferencedSegmentNumber=n + 1)],
        )
        for n, k in frames
    ]
    save(made, path)


def save(made, path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        pydicom.dcmwrite(path, made, enforce_file_format=True)
