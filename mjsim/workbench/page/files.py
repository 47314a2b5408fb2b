"""Report and video of the present model, for download."""

from __future__ import annotations

import tempfile
from pathlib import Path

from mjsim.io.extras import need
from mjsim.progress import Progress
from mjsim.workbench.state import Workbench


def report_of(bench: Workbench, progress: Progress) -> bytes:
    """The report of the present model, without a new diagnosis.

    Raises:
        InputError: The extra "report" is not installed, or nothing was measured.
    """
    from mjsim.report.write import report  # slow to load

    result = report(bench.campaign, bench.machine, diagnosed=False, threads=bench.opened.threads, progress=progress)
    return result.html.encode()


def video_of(bench: Workbench, name: str, progress: Progress) -> bytes:
    """A video of one test with the present model, MP4.

    Raises:
        InputError: The extra "video" is not installed, or there is no OpenGL.
    """
    need("video", "video", "av", "PIL")
    from mjsim.animation.movie import animate  # not above: its import needs the extra

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "film.mp4"
        animate(bench.campaign, name, file, bench.machine, threads=bench.opened.threads, progress=progress)
        return file.read_bytes()
