"""Landmarks of an actor in a video of yours, by MediaPipe's Face Landmarker, as the CSV that `make capture` reads.

`python -m replicate.capture.video_landmarks actor.mp4 face_landmarker.task actor.csv` needs `pip install mediapipe`,
which is no part of the suite, and the model's file, which you get from its makers: nothing is downloaded here. It has
not been tried on real footage, since the project has no video.
"""

import argparse
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from data_recipes.catalogue import FACE_LANDMARKS
from replicate.base.command_line import guard
from replicate.base.exceptions import InputError
from replicate.base.tables import Column, read_csv
from replicate.base.user_files import check_output_file, is_file, shown_path
from replicate.capture.landmark_file import PIXELS, write_landmarks

POINTS = Path(__file__).with_name("mediapipe_points.csv")
SCHEMA = (Column("landmark"), Column("point", "whole number"))
DETECTED = 478  # points that the model gives for a face
ADVICE = ": `pip install mediapipe` brings it, or write the CSV with another tracker"


def chosen_points(file: Path = POINTS) -> Int[np.ndarray, " l"]:
    """Return which of MediaPipe's 478 points each landmark of `FACE_LANDMARKS` is, in their order."""
    table = read_csv(file, SCHEMA, ("landmark",), missing="there is no such table.").set_index("landmark")["point"]
    return table.loc[list(FACE_LANDMARKS)].to_numpy(np.int64)


def pixel_landmarks(
    faces: Iterable[Float[np.ndarray, "p 2"] | None], width: float, height: float
) -> Float[np.ndarray, "t l 2"]:
    """Return landmarks in pixels, y down, from the points detected in each frame.

    faces: points in shares of the picture's width and height, as MediaPipe gives them; None where no face was found,
    which gives NaN. Raises InputError where no frame has a face.
    """
    points = chosen_points()
    missing = np.full((len(points), 2), np.nan)
    places = [missing if face is None else np.asarray(face)[points] * (width, height) for face in faces]
    if not any(np.isfinite(place).all() for place in places):
        raise InputError("no face was found in any frame of the video: it has to show a face that looks at the camera")
    return np.stack(places)


def without_ends(places: Float[np.ndarray, "t l 2"]) -> Float[np.ndarray, "u l 2"]:
    """Return the frames from the first to the last in which a face was found."""
    found = np.flatnonzero(np.isfinite(places).all(axis=(1, 2)))
    return places[found[0] : found[-1] + 1]


def track(video: Path, model: Path, out: Path) -> str:
    """Write the landmarks of the face in a video and return a sentence about them.

    model: MediaPipe's face_landmarker.task. Raises InputError without MediaPipe or OpenCV, which comes with it, for
    files that are missing or cannot be read, and for a video without a face.
    """
    for file in (video, model):
        if not is_file(file):
            raise InputError(f"{shown_path(file)}: there is no such file")
    check_output_file(out)
    try:
        import cv2
        import mediapipe
    except ImportError as error:
        raise InputError(f"landmarks of a video need MediaPipe, and {error.name} isn't installed{ADVICE}") from None
    capture = cv2.VideoCapture(str(video))
    try:
        if not capture.isOpened():
            raise InputError(f"{shown_path(video)}: OpenCV can't read this video")
        rate = capture.get(cv2.CAP_PROP_FPS) or 24.0
        size = (int(capture.get(property)) for property in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
        places = pixel_landmarks(_faces(mediapipe, cv2, capture, model, rate), *size)
    finally:
        capture.release()
    places = without_ends(places)
    write_landmarks(out, places, tuple(FACE_LANDMARKS), PIXELS)
    lost = int(np.isnan(places).any(axis=(1, 2)).sum())
    return (
        f"{len(places)} frames, {lost} of them without a face; the video has {rate:g} frames a second: put "
        f'`[capture] frames_per_second = {rate:g}` and `head = "steady"` into the CONFIG file of `make capture`'
    )


def _faces(mediapipe, cv2, capture, model: Path, rate: float) -> Iterator[np.ndarray | None]:
    """Yield each frame's points, (478, 2) in shares of the picture, or None."""
    vision = mediapipe.tasks.vision
    options = vision.FaceLandmarkerOptions(
        base_options=mediapipe.tasks.BaseOptions(model_asset_path=str(model)),
        running_mode=vision.RunningMode.VIDEO,
        num_faces=1,
    )
    try:
        landmarker = vision.FaceLandmarker.create_from_options(options)
    except (RuntimeError, ValueError) as error:
        raise InputError(f"{shown_path(model)}: MediaPipe can't read this model ({error})") from None
    with landmarker:
        index = 0
        while True:
            there, picture = capture.read()
            if not there:
                return
            colours = cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)
            image = mediapipe.Image(image_format=mediapipe.ImageFormat.SRGB, data=colours)
            found = landmarker.detect_for_video(image, round(1000 * index / rate)).face_landmarks
            yield np.array([(point.x, point.y) for point in found[0][:DETECTED]]) if found else None
            index += 1


def main(arguments: Sequence[str] | None = None) -> int:
    """Track a face from the command line; return the exit code, 2 for bad input."""
    parser = argparse.ArgumentParser(prog="python -m replicate.capture.video_landmarks", description="Track a face.")
    parser.add_argument("video", type=Path, help="a video of yours, as OpenCV reads it")
    parser.add_argument("model", type=Path, help="MediaPipe's face_landmarker.task")
    parser.add_argument("out", type=Path, help="the CSV to write, for make capture LANDMARKS=")
    options = parser.parse_args(arguments)
    return guard(lambda: print(f"written to {options.out}: {track(options.video, options.model, options.out)}"))


if __name__ == "__main__":
    sys.exit(main())
