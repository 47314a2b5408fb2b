"""``mjsim animate``."""

from __future__ import annotations

import click

from mjsim.cli import common


@click.command("animate")
@common.campaign_argument
@common.machine_option
@click.option(
    "--test",
    "tests",
    multiple=True,
    shell_complete=common.test_names,
    help="The test to show (with --ladder: up to nine of them).",
)
@common.file_option("-o", "--out", required=True, help="File to write: .mp4 or .gif.")
@click.option(
    "--ladder", is_flag=True, help="Show the models of the campaign's history one after the other instead of one test."
)
@click.option("--camera", default=None, help="overview (default), closeup, side, or bar, which follows the ball bar.")
@click.option("--size", default=None, help="WIDTHxHEIGHT in pixels (default: 1280x720; GIF: 800x450).")
@click.option("--fps", type=common.NUMBER, default=None, help="Frames per second (default: 25; GIF: 10).")
@click.option(
    "--speed",
    type=common.NUMBER,
    default=None,
    help="Times real time (default: 1, faster where the video gets too long).",
)
@click.option(
    "--seconds", type=common.NUMBER, default=None, help="Length of the video (default: up to 20; GIF: up to 8)."
)
@click.option("--magnify", default="auto", show_default=True, help="How many times its size the error is drawn.")
@click.option("--shadows", is_flag=True, help="Draw shadows; takes longer.")
@click.option("--force", is_flag=True, help="Replace a file that exists.")
@common.as_is_option
@common.threads_option
@common.options
def command(
    campaign, machine, tests, out, ladder, camera, size, fps, speed, seconds, magnify, shadows, force, threads, as_is
) -> None:
    """Write a video of a test of CAMPAIGN: the machine moving, the bar's error magnified, the trace growing beside it.

    What is magnified is measured less simulated, or the simulated deviation where nothing was measured; the factor
    stands in the picture. With --ladder: the residuals of all tests collapsing from model to model. Of an axis log: the
    measured motion with its error magnified about the simulated one, and the error over time.

    \b
    Example: mjsim animate my-campaign --test cone15-y50-ccw -o cone.mp4
             mjsim animate my-campaign --ladder -o ladder.mp4
    """
    factor = _factor(magnify)
    if speed is not None and seconds is not None:
        raise click.UsageError("--speed and --seconds exclude each other")
    if ladder:
        for name, value in (
            ("--machine", machine),
            ("--camera", camera),
            ("--speed", speed),
            ("--magnify", factor),
            ("--shadows", shadows or None),
        ):
            if value is not None:
                raise click.UsageError(f"{name} has no meaning with --ladder")
    elif len(tests) != 1:
        raise click.UsageError("one --test is needed (or --ladder); `mjsim simulate` and campaign.toml have the names")
    from mjsim.campaign.files import read_campaign
    from mjsim.instruments.base import INSTRUMENTS

    c = read_campaign(campaign, as_is=as_is)
    recorded = not ladder and any(t.name == tests[0] and not INSTRUMENTS[t.instrument].in_motion for t in c.tests)
    if recorded and (camera is not None or speed is not None or shadows):
        raise click.UsageError("--camera, --speed and --shadows have no meaning without a ball bar")
    with common.progress_bar(left=True) as progress:
        if recorded:
            from mjsim.animation.recording import animate_recording
            from mjsim.campaign.machine_file import machine_of

            m = machine_of(c, machine)
            more = (size, fps, seconds, factor, force, common.cores(threads), progress)
            film = animate_recording(c, tests[0], out, m, *more)
            about = {"test": film.test, "magnification": film.magnification}
            words = f"error magnified {film.magnification:g} times"
        elif ladder:
            from mjsim.animation.ladder import animate_ladder

            film = animate_ladder(c, out, tests, size, fps, seconds, force, common.cores(threads), progress)
            about = {
                "tests": list(film.tests),
                "models": [{"label": name, "rms_um": round(rms * 1e6, 4)} for name, rms in film.models],
            }
            words = f"{len(film.models)} models, {len(film.tests)} tests"
        else:
            from mjsim.animation.gl import chosen

            chosen()  # before anything imports MuJoCo, which fails where MUJOCO_GL names what is missing
            from mjsim.animation.movie import animate
            from mjsim.campaign.machine_file import machine_of

            m = machine_of(c, machine)
            film = animate(
                c,
                tests[0],
                out,
                m,
                camera or "overview",
                size,
                fps,
                speed,
                seconds,
                factor,
                shadows,
                force,
                common.cores(threads),
                progress,
            )
            about = {"test": film.test, "camera": film.camera, "speed": round(film.speed, 4)}
            about |= {"magnification": film.magnification, "magnified": film.magnified}
            words = film.magnified
    size_px = {"width": film.size[0], "height": film.size[1]}
    if not common.answered(
        {
            "file": str(film.file),
            "frames": film.frames,
            "fps": film.fps,
            "seconds": round(film.seconds, 3),
            **size_px,
            **about,
        }
    ):
        common.say(f"{film.file}: {film.seconds:.1f} s, {film.size[0]}x{film.size[1]}, {words}")


def _factor(text: str) -> float | None:
    """``--magnify`` as a number, ``None`` for auto."""
    if text == "auto":
        return None
    try:
        return float(text)
    except ValueError:
        raise click.UsageError(f"--magnify {text!r}: a number or auto") from None
