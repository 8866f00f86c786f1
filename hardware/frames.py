"""Read pictures: from a camera, in a thread, or from files."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from tactilenlp.common.validation import check_one_of, check_range

from .clock import Clock
from .errors import BusError, RecordingError, RigError
from .optical_flow import opencv
from .ranges import check_ranges
from .reader import FIRST_WAIT, Reader

HANG = 1.0  # [s] that closing waits for a read that does not return
QUEUE = 64  # [pictures] that wait to be taken: 2 s at 30 Hz
CAMERA_RANGES = {  # of its options: how many numbers, lowest, highest, unit
    "size": (2, 1, 100_000, "px"),
    "rate": (1, 1e-3, 1e5, "Hz"),
    "exposure": (1, -1e9, 1e9, ""),
}
NATURAL = "f_%05d.png"  # how recorded pictures are named


def check_camera(where: str, options: dict) -> None:
    """Raise RigError for options that a Camera does not take, or out of range."""
    for name, value in options.items():
        check_one_of(where, name, CAMERA_RANGES, "wrong options", RigError)
        count, *limits = CAMERA_RANGES[name]
        if value is None:
            continue
        if count > 1:
            check_ranges(f"camera.{name}", value, count, *limits, RigError)
        else:
            check_range(f"camera.{name}", value, *limits, RigError)


class Camera(Reader):
    """Read a camera in a thread; `with` opens it and does not wait for a picture.

    source:   number or path of the camera, or a function that waits for the next
              picture and returns it, None once there are no more
    size:     (width, height) [px], None: as the camera is
    rate:     [Hz], None: as the camera is
    exposure: in the camera's unit; a DenseTact needs a fixed one
    sink:     called with every picture and its time, to record it

    The time stamps of OpenCV are not reliable: the time of a picture is its arrival,
    and the latency of the camera must be subtracted later.  A picture that is equal to
    the previous one is dropped and counted in `frozen`: real pictures have noise.
    """

    def __init__(
        self,
        source: int | str | Callable[[], np.ndarray | None],
        *,
        name: str = "camera",
        size: tuple[int, int] | None = None,
        rate: float | None = None,
        exposure: float | None = None,
        sink: Callable[[np.ndarray, float], None] | None = None,
        clock: Clock | None = None,
    ) -> None:
        super().__init__(name, clock, HANG, QUEUE)
        self.source, self.sink = source, sink
        self.size, self.rate, self.exposure = size, rate, exposure
        self.good = self.frozen = 0
        self._last: np.ndarray | None = None

    def _until_lost(self) -> str:
        if callable(self.source):
            return self._read(self.source)
        cv2 = opencv()
        camera = cv2.VideoCapture(self.source)
        try:
            if not camera.isOpened():
                return "cannot be opened"
            for key, value in zip(
                (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT),
                self.size or (),
                strict=False,
            ):
                camera.set(key, value)
            if self.rate is not None:
                camera.set(cv2.CAP_PROP_FPS, self.rate)
            if self.exposure is not None:
                camera.set(cv2.CAP_PROP_AUTO_EXPOSURE, 1)  # V4L2: 1 is manual
                camera.set(cv2.CAP_PROP_EXPOSURE, self.exposure)
            return self._read(lambda: camera.read()[1])
        finally:
            camera.release()

    def _read(self, read: Callable[[], np.ndarray | None]) -> str:
        while not self._leave.is_set() and (frame := read()) is not None:
            self.on_picture(frame)
            self._wait = FIRST_WAIT
        return "no more pictures"

    def on_picture(self, frame: np.ndarray) -> None:
        """Process one picture that has just come; BusError if it has another size.

        OpenCV does not say that a camera cannot have the size it is told to have; then
        the lens of the rig would be that of other pictures, and normals wrong.
        """
        now = self.clock.now()
        got = frame.shape[1::-1]
        if self.size is not None and got != tuple(self.size):
            raise BusError(
                "pictures of another size",
                where=self.name,
                got=f"{got} px",
                expected=f"{tuple(self.size)} px (camera.size)",
                next="give a size that the camera has, and the lens for it",
            )
        if self._last is not None and np.array_equal(frame, self._last):
            self.frozen += 1
            return
        self._last, self.good = frame, self.good + 1
        if self.sink is not None:
            self.sink(frame, now)
        self._keep(now, [frame])


def pictures(path: str | Path) -> Iterator[np.ndarray]:
    """Yield the pictures of a video, or of a folder of .png in natural order.

    Raises RecordingError where there are none, or one cannot be read.
    """
    path, cv2 = Path(path), opencv()
    if path.is_dir():
        files = sorted(path.glob("*.png"), key=lambda p: (len(p.stem), p.stem))
        read = (cv2.imread(str(file), cv2.IMREAD_UNCHANGED) for file in files)
    else:
        files, read = [path], _video(path)
    seen = 0
    for seen, picture in enumerate(read, start=1):
        if picture is None:
            fix = "remove the file, or write it again"
            raise RecordingError("no picture", where=str(files[seen - 1]), next=fix)
        yield picture
    if not seen:
        fix = "give a video, or a folder of .png"
        raise RecordingError("no pictures", where=str(path), next=fix)


def _video(path: Path) -> Iterator[np.ndarray]:
    video = opencv().VideoCapture(str(path))
    try:
        while (frame := video.read()[1]) is not None:
            yield frame
    finally:
        video.release()
