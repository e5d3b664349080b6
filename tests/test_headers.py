"""Image headers: damaged and hostile ones are refused in a moment, and no byte is made up."""

import gzip
import struct
import zlib

import numpy as np
import pytest

from header_fuzz import FORMATS, Reader, damaged, write_samples
from sonospline.io.labels import read_labels
from sonospline.io.volumes import read_volume

pytest.importorskip("SimpleITK", reason="needs the extra 'io'")


def fuzz(folder, tries, seed):
    """Read so many damaged files; return those that did more than to be read or refused in one line."""
    write_samples(folder)
    sound = {name: (folder / name).read_bytes() for name in FORMATS}
    rng, faults, counts = np.random.default_rng(seed), [], {"read": 0, "refused": 0}
    with Reader() as reader:
        for k in range(tries):
            name = FORMATS[k % len(FORMATS)]
            content, way = damaged(sound[name], name, rng)
            path = folder / f"spoilt.{name}"
            path.write_bytes(content)
            for outcome, message in reader.read(path):
                cut = way == "_cut" and content.strip() != sound[name].strip()
                unclear = outcome == "refused" and ("\n" in message or path.name not in message)
                if outcome not in counts or unclear or (cut and outcome == "read"):
                    kept = folder / f"fault-{k}.{name}"
                    kept.write_bytes(content)
                    faults.append((kept, way, outcome, message))
                else:
                    counts[outcome] += 1
    return faults, counts


def test_damaged_headers_are_refused_in_a_moment(tmp_path):
    faults, counts = fuzz(tmp_path, 160, seed=1)
    assert faults == []
    assert min(counts.values()) > 10


@pytest.mark.slow
def test_more_damaged_headers_are_refused_in_a_moment(tmp_path):
    faults, counts = fuzz(tmp_path, 1500, seed=2)
    assert faults == []
    assert min(counts.values()) > 90


# --- how many bytes there must be ---

SHAPE = (9, 8, 7)
STORED = np.random.default_rng(3).integers(0, 4000, SHAPE).astype("<i2")
BYTES = STORED.tobytes(order="F")


def nifti(*, start=352, slope=1.0, intercept=0.0, voxels=BYTES, shape=SHAPE, kind=4, order="<"):
    """A NIfTI-1 file with a header extension up to where its voxels start."""
    header = bytearray(start)
    struct.pack_into(order + "i8h", header, 0, 348, *[0] * 8)
    struct.pack_into(order + "8h", header, 40, 3, *shape, 1, 1, 1, 1)
    struct.pack_into(order + "hh", header, 70, kind, 16)
    struct.pack_into(order + "8f", header, 76, *[1.0] * 8)
    struct.pack_into(order + "3f", header, 108, start, slope, intercept)
    struct.pack_into(order + "2h", header, 252, 0, 1)
    struct.pack_into(order + "12f", header, 280, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0)
    header[344:348] = b"n+1\0"
    if start > 352:
        struct.pack_into(order + "4b2i", header, 348, 1, 0, 0, 0, start - 352, 4)
    return bytes(header) + voxels


def meta_image(data="LOCAL", **fields):
    """A MetaImage header."""
    plain = {
        "ObjectType": "Image", "NDims": 3, "BinaryData": True, "BinaryDataByteOrderMSB": False,
        "CompressedData": False, "TransformMatrix": "1 0 0 0 1 0 0 0 1", "Offset": "0 0 0",
        "ElementSpacing": "1 1 1", "DimSize": "9 8 7", "ElementType": "MET_SHORT",
    }  # fmt: skip
    return "".join(f"{k} = {v}\n" for k, v in {**plain, **fields, "ElementDataFile": data}.items()).encode()


def nrrd(*lines, kind="short", sizes="9 8 7", encoding="raw"):
    """A NRRD header."""
    plain = [f"type: {kind}", "dimension: 3", "space: left-posterior-superior", f"sizes: {sizes}", "endian: little",
             "space directions: (1,0,0) (0,1,0) (0,0,1)", f"encoding: {encoding}", "space origin: (0,0,0)"]  # fmt: skip
    return "\n".join(["NRRD0004", *plain, *lines, "", ""]).encode()


def write(folder, files):
    """Write files, the first of them the one to read; return its path."""
    for name, content in files.items():
        (folder / name).write_bytes(content)
    return folder / next(iter(files))


PACKED = zlib.compress(BYTES)
WAYS = {
    "nifti with an extension": {"v.nii": nifti(start=13168)},
    "nifti, packed, with an extension": {"v.nii.gz": gzip.compress(nifti(start=13168))},
    "nifti in two gzip members": {"v.nii.gz": gzip.compress(nifti()[:700]) + gzip.compress(nifti()[700:])},
    "meta image": {"v.mha": meta_image() + BYTES},
    "meta image, packed": {
        "v.mha": meta_image(CompressedData=True, CompressedDataSize=len(PACKED)) + PACKED,
    },
    "meta image, bytes before": {"v.mhd": meta_image("v.raw", HeaderSize=100), "v.raw": b"x" * 100 + BYTES},
    "meta image, from the end": {"v.mhd": meta_image("v.raw", HeaderSize=-1), "v.raw": b"x" * 55 + BYTES},
    "nrrd": {"v.nrrd": nrrd() + BYTES},
    "nrrd, packed": {"v.nrrd": nrrd(encoding="gzip") + gzip.compress(BYTES)},
    "nrrd, apart": {"v.nhdr": nrrd("data file: v.raw"), "v.raw": BYTES},
    "nrrd, bytes before": {"v.nhdr": nrrd("data file: v.raw", "byte skip: 30"), "v.raw": b"x" * 30 + BYTES},
    "nrrd, lines before": {"v.nhdr": nrrd("data file: v.raw", "line skip: 2"), "v.raw": b"one\ntwo\n" + BYTES},
    "nrrd, from the end": {"v.nhdr": nrrd("data file: v.raw", "byte skip: -1"), "v.raw": b"x" * 77 + BYTES},
    "nrrd, digits": {
        "v.nrrd": nrrd(encoding="ascii") + " ".join(map(str, STORED.ravel(order="F"))).encode(),
    },
}  # fmt: skip


@pytest.mark.parametrize("way", WAYS)
def test_voxels_are_read_wherever_a_format_lets_them_lie(tmp_path, way):
    volume = read_volume(write(tmp_path, WAYS[way]))
    assert np.array_equal(volume.voxels, STORED)
    assert volume.voxels.dtype == np.int16


@pytest.mark.parametrize("missing", [1, 9, 400])
@pytest.mark.parametrize("way", WAYS)
def test_a_file_that_lacks_bytes_is_refused(tmp_path, way, missing):
    files = dict(WAYS[way])
    last = list(files)[-1]
    files[last] = files[last][: -missing - 4 * ("digits" in way)]  # a shorter number is a number
    if way in ("meta image, from the end", "nrrd, from the end"):
        files[last] = files[last][80:]  # else other bytes are taken for voxels, and nothing can tell
    with pytest.raises(ValueError, match=r"volume = '.*v\.\w+.*' cannot be read"):
        read_volume(write(tmp_path, files))


def test_a_stream_that_unpacks_to_too_little_is_refused(tmp_path):
    short = zlib.compress(BYTES[:-100])
    cases = {
        "v.mha": meta_image(CompressedData=True, CompressedDataSize=len(short)) + short,
        "w.mha": meta_image(CompressedData=True) + PACKED,
        "v.nrrd": nrrd(encoding="gzip") + gzip.compress(BYTES[:-100]),
        "v.nii.gz": gzip.compress(nifti()[:-100]),
    }
    flipped = bytearray(gzip.compress(nifti()))
    flipped[-6] ^= 1  # of the checksum
    cases["flipped.nii.gz"] = bytes(flipped)
    for name, content in cases.items():
        with pytest.raises(ValueError, match=f"{name}' cannot be read"):
            read_volume(write(tmp_path, {name: content}))


@pytest.mark.parametrize("suffix", [".nii", ".nii.gz"])
def test_a_nifti_scale_is_applied(tmp_path, suffix):
    """A common converter stores every CT as unsigned numbers and an intercept."""
    content = nifti(slope=1.0, intercept=-1024.0, start=368)
    path = write(tmp_path, {f"ct{suffix}": gzip.compress(content) if suffix == ".nii.gz" else content})
    assert np.array_equal(read_volume(path).voxels, STORED - 1024.0)
    labels = (STORED % 5).astype("<i2")
    content = nifti(slope=1 / 3, voxels=(labels * 3).tobytes(order="F"))
    path = write(tmp_path, {f"labels{suffix}": gzip.compress(content) if suffix == ".nii.gz" else content})
    assert np.array_equal(read_labels(path).voxels, labels)


def test_a_nifti_scale_that_readers_apply_differently_is_refused(tmp_path):
    for slope, intercept in ((0.0, 7.0), (np.inf, 0.0), (1.0, np.nan)):
        path = write(tmp_path, {"ct.nii": nifti(slope=slope, intercept=intercept)})
        with pytest.raises(ValueError, match=r"ct\.nii' cannot be read \(scale slope"):
            read_volume(path)
    for slope in (0.0, np.nan):  # both mean that nothing is scaled
        assert np.array_equal(read_volume(write(tmp_path, {"ct.nii": nifti(slope=slope)})).voxels, STORED)


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({"v.mha": meta_image(ElementToIntensityFunctionSlope=2) + BYTES}, r"Slope = '2' is not applied\); save"),
        ({"v.mha": meta_image(HeaderSize=4) + BYTES}, "HeaderSize = 4"),
        ({"v.mha": meta_image(NDims=-1) + BYTES}, "NDims = -1"),
        ({"v.mha": meta_image(NDims=4294967297) + BYTES}, "NDims = 4294967297"),
        ({"v.mha": meta_image(DimSize="1048576 1048576 1048576") + BYTES}, "fewer bytes|would take"),
        ({"v.mhd": meta_image("LIST") + b"a.raw\n"}, r"in several files, 'LIST'\); save the image as one"),
        ({"v.mhd": meta_image("v%03d.raw 1 7 1")}, "voxels in several files"),
        ({"v.mhd": meta_image("gone.raw")}, "'gone.raw', which is no file here"),
        ({"v.nhdr": nrrd("data file: LIST", "a.raw")}, "which is not known"),
        ({"v.nrrd": nrrd(sizes="1048576 1048576 1048576") + BYTES}, "fewer bytes|would take"),
        ({"v.nrrd": nrrd(sizes="9 8 18446744073709551623") + BYTES}, "sizes"),
        ({"v.nrrd": nrrd(kind="block") + BYTES}, "type = 'block'"),
        ({"v.nrrd": nrrd('space units: "m" "m" "m"') + BYTES}, "space units = 'm', and only millimetres are read"),
        ({"v.mha": meta_image(DistanceUnits="um") + BYTES}, "DistanceUnits = 'um', and only millimetres are read"),
        ({"v.nii": nifti(shape=(32767,) * 3)}, "fewer bytes|would take"),
        ({"v.nii.gz": gzip.compress(nifti(shape=(2000, 2000, 800)))}, "fewer bytes|would take"),
        ({"v.nii": nifti(kind=1536)}, "voxels of type 1536"),
        ({"v.nii": nifti(kind=32, voxels=4 * BYTES)}, "2 channels a voxel"),
        ({"v.nii": b"\x1c\x02\0\0" + nifti()[4:]}, "NIfTI-2, which is not read.*; save it as NIfTI-1"),
    ],
)  # fmt: skip
def test_headers_that_cannot_be_true_are_refused_by_the_name_of_the_file(tmp_path, files, message):
    with pytest.raises(ValueError, match=message) as refusal:
        read_volume(write(tmp_path, files))
    assert next(iter(files)) in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("files", [
    {"v.mha": meta_image(TransformMatrix="1 0 0 0.3 1 0 0 0 1") + BYTES},
    {"v.nrrd": nrrd().replace(b"(0,1,0)", b"(0.3,1,0)") + BYTES},
    {"v.nii": nifti()[:284] + struct.pack("<f", 0.3) + nifti()[288:]},
])  # fmt: skip
def test_a_sheared_image_is_refused_by_the_name_of_the_file(tmp_path, files):
    with pytest.raises(ValueError, match=r"v\.\w+'.*orthonormal.*; resample the image onto axes at right angles"):
        read_volume(write(tmp_path, files))


# --- what is no volume ---

POSES = {f"Seq_Frame{k:04d}_ImageToReferenceTransform": "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1" for k in range(7)}


@pytest.mark.parametrize("files", [
    {"rec.igs.mha": meta_image(Kinds="domain domain list", **POSES) + BYTES},
    {"rec.mha": meta_image(**POSES) + BYTES},
    {"rec.igs.mha": meta_image(Kinds="domain domain list") + BYTES},
    {"rec.nrrd": nrrd(*(f"{k}:={v}" for k, v in POSES.items())) + BYTES},
])  # fmt: skip
def test_a_tracked_recording_is_no_volume(tmp_path, files):
    with pytest.raises(ValueError, match=r"rec\..*' is a tracked recording of 7 frames, not a 3-D image; reconstruct"):
        read_volume(write(tmp_path, files))


def test_a_volume_that_a_tracking_program_wrote_is_one(tmp_path):
    """PLUS leaves ``Kinds = domain domain list`` in the volumes it reconstructs."""
    path = write(tmp_path, {"volume.mha": meta_image(Kinds="domain domain list") + BYTES})
    assert np.array_equal(read_volume(path).voxels, STORED)


def test_a_segmentation_in_layers_is_told_what_to_become(tmp_path):
    header = nrrd(sizes="2 9 8 7").replace(b"dimension: 3", b"dimension: 4").replace(b"(1,0,0) (0", b"none (1,0,0) (0")
    header = header.replace(b"encoding", b"kinds: list domain domain domain\nencoding")
    path = write(tmp_path, {"s.seg.nrrd": header + 2 * BYTES})
    with pytest.raises(ValueError, match=r"s\.seg\.nrrd' is a segmentation in several layers; export it"):
        read_labels(path)


def test_what_is_unpacked_here_is_what_simpleitk_reads(tmp_path):
    sitk = pytest.importorskip("SimpleITK")
    for kind in ("u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8"):
        voxels = (np.random.default_rng(1).standard_normal(SHAPE[::-1]) * 40).astype(kind)
        for suffix in (".mha", ".nrrd", ".nii.gz", ".mhd", ".nhdr"):
            path = tmp_path / f"{kind}{suffix}"
            sitk.WriteImage(sitk.GetImageFromArray(voxels), str(path), useCompression=True)
            found = read_volume(path).voxels
            assert found.dtype == voxels.dtype
            assert np.array_equal(found, voxels.transpose(2, 1, 0))
            assert found.flags.f_contiguous
            assert found.flags.writeable


def test_numbers_of_the_other_byte_order_are_read(tmp_path):
    swapped = STORED.astype(">i2").tobytes(order="F")
    packed = zlib.compress(swapped)
    big = {"BinaryDataByteOrderMSB": True}
    cases = {
        "a.mha": meta_image(**big) + swapped,
        "b.mha": meta_image(**big, CompressedData=True, CompressedDataSize=len(packed)) + packed,
        "a.nrrd": nrrd().replace(b"little", b"big") + swapped,
        "b.nrrd": nrrd(encoding="gzip").replace(b"little", b"big") + gzip.compress(swapped),
        "a.nii": nifti(order=">", voxels=swapped),
        "b.nii.gz": gzip.compress(nifti(order=">", voxels=swapped)),
    }
    for name, content in cases.items():
        assert np.array_equal(read_volume(write(tmp_path, {name: content})).voxels, STORED)


def test_voxels_that_are_no_numbers_one_can_reckon_with_are_refused(tmp_path):
    for value in (np.inf, -np.inf, 1e300):
        voxels = np.ones(SHAPE, "<f8")
        voxels[2, 3, 4] = value
        path = write(tmp_path, {"v.mha": meta_image(ElementType="MET_DOUBLE") + voxels.tobytes(order="F")})
        with pytest.raises(ValueError, match=r"v\.mha' has a voxel of .*; give numbers of at most 1e\+30"):
            read_volume(path)
    voxels[2, 3, 4] = np.nan
    path = write(tmp_path, {"v.mha": meta_image(ElementType="MET_DOUBLE") + voxels.tobytes(order="F")})
    assert np.isnan(read_volume(path).voxels).sum() == 1


def test_what_a_user_wrote_into_a_header_is_no_matter(tmp_path):
    """Programs keep the elements of a DICOM file, and whatever they like, beside what the format asks for."""
    own = {"0008|0060": "CT", "my own key": "3 = 4", "patient": "a: b", "empty": "", "NDims2": -1}
    lines = [
        "0008|0060:=CT",
        "Segment0_Name:=left: kidney",
        "a:b:=c",
        "odd=key:=y",
        "# NRRD0004: x",
        'labels: "i" "j" "k"',
    ]
    windows = meta_image().replace(b"Offset", b"notes = one\ntwo\n\nOffset").replace(b"\n", b"\r\n")
    cases = {"v.mha": meta_image(**own) + BYTES, "v.nrrd": nrrd(*lines) + BYTES, "w.mha": windows + BYTES}
    for name, content in cases.items():
        assert np.array_equal(read_volume(write(tmp_path, {name: content})).voxels, STORED)


@pytest.mark.slow
def test_a_long_line_costs_no_time(tmp_path):
    cases = {
        "blanks.mha": meta_image(Comment="a" + 60_000 * " " + "b") + BYTES[1:],
        "digits.mha": meta_image(Offset="0 0 " + 60_000 * "1" + "x") + BYTES,
        "digits.nrrd": nrrd("measurement frame: (" + 100_000 * "1" + "x)") + BYTES,
        "brackets.nrrd": nrrd("axis mins: " + 100_000 * "(") + BYTES,
        "blanks.nrrd": nrrd("content:" + 100_000 * " " + "x") + BYTES[1:],
        "endless.mha": b"a=b\n" * 300_000,
        "endless.nrrd": b"NRRD0004\n" + b"#\n" * 300_000,
        "lines.mha": b"a=b\n" * 200_000,
        "units.nrrd": nrrd("units: " + 1000 * '"mm" ') + BYTES,
        "label.nrrd": nrrd('labels: "' + 30_000 * "m") + BYTES,
    }
    with Reader(limit_s=10) as reader:
        for name, content in cases.items():
            assert reader.read(write(tmp_path, {name: content}))[0][0] == "refused", name
