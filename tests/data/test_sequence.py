"""Folders in KITTI's layout: their content, and the errors for invalid folders."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import BASELINE, FOCAL, HEIGHT, WIDTH

from vo_lib import DataError, open_sequence
from vo_lib.data.kitti import read_image
from vo_lib.runs.front_end import stereo_ahead

SIDES = ("image_0", "image_1")


def test_folder_has_camera_times_and_truth(bands: Path) -> None:
    sequence = open_sequence(bands)
    assert len(sequence) == 6
    assert sequence.frames[0] == "000000"
    camera = sequence.camera
    assert (camera.f, camera.cx, camera.cy) == (FOCAL, WIDTH / 2, HEIGHT / 2)
    assert (camera.baseline, camera.width, camera.height) == (BASELINE, WIDTH, HEIGHT)
    assert sequence.truth is not None
    assert sequence.truth[5, 0, 3] == 5 * BASELINE
    np.testing.assert_allclose(sequence.times[5], 0.5)


def test_baseline_is_the_distance_between_the_cameras(bands: Path) -> None:
    """KITTI's colour cameras are not at the origin, so the last column of P2 is not zero."""
    words = (bands / "calib.txt").read_text(encoding="utf-8").split()
    words[4] = str(float(words[4]) + 30.0)  # P0[0,3]
    words[17] = str(float(words[17]) + 30.0)  # P1[0,3]
    (bands / "calib.txt").write_text(f"{' '.join(words[:13])}\n{' '.join(words[13:])}\n", encoding="utf-8")
    assert open_sequence(bands).camera.baseline == pytest.approx(BASELINE)


def test_part_has_its_images_times_and_truth(bands: Path) -> None:
    part = open_sequence(bands).part(2, 5)
    assert part.frames == ("000002", "000003", "000004")
    assert part.truth is not None
    assert part.truth[0, 0, 3] == 2 * BASELINE
    np.testing.assert_allclose(part.times[0], 0.2)
    for start, stop in ((0, 7), (-1, 3), (3, 3), (4, 5), (5, 2)):
        with pytest.raises(DataError, match="0:6"):
            open_sequence(bands).part(start, stop)


def test_unknown_name_of_a_kitti_sequence_is_refused_with_the_folder_and_a_near_name(
    bands: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(bands, tmp_path / "kitti" / "sequences" / "01")
    monkeypatch.setenv("KITTI_ROOT", str(tmp_path / "kitti"))
    for name, words in (
        ("kitti/1", "did you mean kitti/01?"),
        ("kitti/07", f"kitti/07 is not in {tmp_path / 'kitti'}: `vo data get_kitti` downloads 00 to 21"),
        ("07", "the folder is missing: did you mean kitti/07?"),
    ):
        with pytest.raises(DataError, match=words):
            open_sequence(name)


def test_truth_in_the_poses_folder_is_read_by_frame_number(bands: Path) -> None:
    root = bands.parent / "root"
    shutil.copytree(bands, root / "sequences" / "05")
    folder = root / "sequences" / "05"
    (root / "poses").mkdir()
    (folder / "poses.txt").rename(root / "poses" / "05.txt")
    remove_pairs(0)(folder)
    sequence = open_sequence(folder)
    assert sequence.truth is not None
    assert sequence.truth[:, 0, 3].tolist() == [BASELINE * i for i in range(1, 6)]
    assert sequence.times[0] == 0.1


def in_kitti_layout(bands: Path, place: str, text: str) -> Path:
    """The band sequence, with its own poses.txt, at a place below a folder that has poses/05.txt, too."""
    root = bands.parent / "root"
    shutil.copytree(bands, root / place)
    (root / "poses").mkdir()
    (root / "poses" / "05.txt").write_text(text, encoding="utf-8")
    return root


@pytest.mark.parametrize(
    ("place", "opened", "wins"),
    [
        ("sequences/05", "sequences/05", "poses/05.txt"),
        ("sequences/05", "link", "poses/05.txt"),
        ("other/05", "sequences/05", "poses/05.txt"),  # a link of the same name
        ("sequences/06", "sequences/06", "sequences/06/poses.txt"),
        ("mine/05", "mine/05", "mine/05/poses.txt"),
    ],
)
def test_truth_of_kitti_counts_before_a_file_in_the_folder(
    bands: Path, place: str, opened: str, wins: str
) -> None:
    root = in_kitti_layout(bands, place, "".join(f"1 0 0 {9 * i} 0 1 0 0 0 0 1 0\n" for i in range(6)))
    if opened != place:
        (root / opened).parent.mkdir(exist_ok=True)
        (root / opened).symlink_to(root / place)
    sequence = open_sequence(root / opened)
    assert sequence.truth_file == root / wins
    assert sequence.part(1, 4).truth_name == wins.removeprefix(f"{place}/")
    assert sequence.true_poses[5, 0, 3] == (45 if wins == "poses/05.txt" else 5 * BASELINE)


def test_truth_of_kitti_that_does_not_fit_is_refused(bands: Path) -> None:
    root = in_kitti_layout(bands, "sequences/05", "1 0 0 0 0 1 0 0 0 0 1 0\n" * 3)
    with pytest.raises(DataError, match=r"poses/05\.txt: 3 rows for 6 frames"):
        open_sequence(root / "sequences" / "05")


def edit(name: str, change: Callable[[str], str]) -> Callable[[Path], object]:
    def apply(folder: Path) -> object:
        path = folder / name
        return path.write_text(change(path.read_text(encoding="utf-8")), encoding="utf-8")

    return apply


def cut(name: str, rows: int) -> Callable[[Path], object]:
    """A function that keeps only the first rows of an image."""
    return lambda folder: cv2.imwrite(str(folder / name), cv2.imread(str(folder / name), 0)[:rows])  # type: ignore[index]


def remove_pairs(*frames: int) -> Callable[[Path], object]:
    def apply(folder: Path) -> None:
        for side in SIDES:
            for frame in frames:
                (folder / side / f"{frame:06d}.png").unlink()

    return apply


# Faults of a single file are in tests/bad_files.json; these faults concern several files.
FAULTS: dict[str, tuple[Callable[[Path], object], str]] = {
    "no calib.txt": (lambda f: (f / "calib.txt").unlink(), r"calib\.txt: .*missing"),
    "skew": (edit("calib.txt", lambda t: t.replace("0 240", "55 240")), r"line 1: P0: expected f 0 cx"),
    "baseline in mm": (
        edit("calib.txt", lambda t: t.replace("-150", "-161100")),
        r"calib\.txt, line 2: P1: the baseline .* is 537 m, expected 0.01 mm to 10 m",
    ),
    "centre outside": (
        edit("calib.txt", lambda t: t.replace("240.0", "90000")),
        r"calib\.txt, line 1: P0: principal point 90000,120: .*inside the images of 480×240 px",
    ),
    "pair missing": (remove_pairs(2), r"000002\.png: .*missing between 000001\.png and 000003\.png"),
    "size": (cut("image_1/000002.png", 230), r"image_1/000002\.png: .* 480×230, expected 480×240"),
    "one frame": (remove_pairs(1, 2, 3, 4, 5), "two or more stereo pairs"),
    "times short": (edit("times.txt", lambda t: "\n".join(t.split("\n")[:3])), r"times\.txt: 3 rows for 6"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_of_a_sequence_are_one_line(bands: Path, fault: str) -> None:
    spoil, words = FAULTS[fault]
    spoil(bands)
    with pytest.raises(DataError, match=words) as caught:
        list(stereo_ahead(open_sequence(bands), lambda pair: pair))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("keep", [0, 7, 60, 0.5, 0.999, None])
def test_damaged_images_are_refused(bands: Path, keep: float | None) -> None:
    path = bands / "image_0" / "000000.png"
    data = bytearray(path.read_bytes())
    if keep is None:
        data[len(data) // 2] ^= 0x10
    else:
        del data[keep if isinstance(keep, int) else int(keep * len(data)) :]
    path.write_bytes(data)
    with pytest.raises(DataError, match="truncated or damaged"):
        read_image(path)


def recoloured(folder: Path) -> None:
    """Only colour images, with matrices P2 and P3 whose left camera is 0.06 m to the right of camera 0."""
    for grey, colour in zip(SIDES, ("image_2", "image_3"), strict=True):
        (folder / colour).mkdir()
        for path in (folder / grey).iterdir():
            image = np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))
            blue = np.stack([image, image // 2, image // 4], axis=-1)
            cv2.imwrite(str(folder / colour / path.name), blue)
        shutil.rmtree(folder / grey)
    matrix = f"{FOCAL} 0 {WIDTH / 2} {{}} 0 {FOCAL} {HEIGHT / 2} 0 0 0 1 0\n"
    shifts = 0.0, -FOCAL * BASELINE, -FOCAL * 0.06, -FOCAL * (0.06 + 0.4)
    lines = [f"P{k}: {matrix.format(shift)}" for k, shift in enumerate(shifts)]
    (folder / "calib.txt").write_text("".join(lines), encoding="utf-8")


def test_colour_images_alone_are_read_as_grey_with_their_own_calibration(bands: Path) -> None:
    grey = open_sequence(bands).stereo(1)[0]
    recoloured(bands)
    turned = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # 90° to the right
    rows = [np.eye(3, 4), np.hstack([turned, [[1.0], [0.0], [2.0]]])]
    text = "".join(" ".join(map(str, row.ravel())) + "\n" for row in [*rows, *[rows[1]] * 4])
    (bands / "poses.txt").write_text(text, encoding="utf-8")
    sequence = open_sequence(bands)
    assert sequence.camera.baseline == pytest.approx(0.4)  # of P2 and P3; P0 and P1 have 0.5
    assert sequence.notes() == [
        "there are only colour images: image_2 and image_3 are read as grey, with P2 and P3 of calib.txt"
    ]
    # OpenCV's weights of blue, green and red: 0.114, 0.587, 0.299.
    expected = 0.114 * grey + 0.587 * (grey // 2) + 0.299 * (grey // 4)
    np.testing.assert_allclose(sequence.stereo(1)[0], expected, atol=1.5)
    # The truth is the path of camera 0; the left colour camera is 0.06 m beside it and turns with it.
    assert sequence.truth is not None
    np.testing.assert_allclose(sequence.truth[0], np.eye(4))
    np.testing.assert_allclose(sequence.truth[1, :3, 3], [1.0 - 0.06, 0.0, 2.0 - 0.06])


@pytest.mark.parametrize("line", ["P2", "P3"])
def test_colour_images_never_have_the_calibration_of_the_grey_cameras(bands: Path, line: str) -> None:
    recoloured(bands)
    text = (bands / "calib.txt").read_text(encoding="utf-8")
    (bands / "calib.txt").write_text(text.replace(line, "Tr"), encoding="utf-8")
    with pytest.raises(DataError, match=rf"calib\.txt: {line} is missing"):
        open_sequence(bands)
    # With both kinds, the grey images are used.
    shutil.copytree(bands / "image_2", bands / "image_0")
    shutil.copytree(bands / "image_3", bands / "image_1")
    assert open_sequence(bands).camera.baseline == pytest.approx(BASELINE)
    shutil.rmtree(bands / "image_1")
    with pytest.raises(DataError, match="the folder image_1 is missing"):
        open_sequence(bands)


def deepened(folder: Path, bits: int, factor: int) -> None:
    """Images of 16 bits: the grey values 0 to 255 times `factor`; the last right image is the brightest."""
    for side in SIDES:
        for path in (folder / side).iterdir():
            image = np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), np.uint16) * factor
            cv2.imwrite(str(path), np.minimum(image, 100))  # dark images
    path = folder / "image_1" / "000005.png"
    image = np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED))
    image[3, 7] = 2**bits - 1
    cv2.imwrite(str(path), image)


@pytest.mark.parametrize(
    ("bits", "shift"), [(8, 0), (9, 2), (10, 2), (11, 4), (12, 4), (14, 6), (15, 8), (16, 8)]
)
def test_grey_values_of_16_bits_are_scaled_by_the_largest_of_all_images(
    bands: Path, bits: int, shift: int
) -> None:
    deepened(bands, bits, 1)
    sequence = open_sequence(bands)
    stored = np.asarray(cv2.imread(str(bands / "image_0" / "000002.png"), cv2.IMREAD_UNCHANGED))
    assert stored.dtype == np.uint16
    assert stored.max() <= 100
    for part, index in ((sequence, 2), (sequence.part(1, 4), 1)):  # also without the brightest image
        np.testing.assert_array_equal(part.stereo(index)[0], stored >> shift)
    note = [f"the grey values need {8 + shift} bits, so they are divided by {2**shift}"] if shift else []
    assert sequence.notes() == note


def test_images_of_8_and_16_bits_are_not_mixed(bands: Path) -> None:
    deepened(bands, 10, 1)
    path = bands / "image_0" / "000003.png"
    cv2.imwrite(str(path), np.zeros((HEIGHT, WIDTH), np.uint8))
    with pytest.raises(DataError, match=r"000003\.png: the image has 8 bits, the other images .* of 10 bits"):
        open_sequence(bands).stereo(3)
    for side in SIDES:
        for frame in range(3):
            cv2.imwrite(str(bands / side / f"{frame:06d}.png"), np.zeros((HEIGHT, WIDTH), np.uint8))
    with pytest.raises(DataError, match=r"000005\.png: the image has 16 bits and grey values up to 1023"):
        open_sequence(bands).stereo(5)


def test_a_video_and_a_folder_of_images_name_the_import(bands: Path) -> None:
    film = bands / "film.mp4"
    film.touch()
    with pytest.raises(DataError, match=r"is a file: .* `vo data from_folder` imports images and videos"):
        open_sequence(film)
    with pytest.raises(DataError, match="vo data from_folder --left DIR --right DIR"):
        open_sequence(bands / "image_0")
