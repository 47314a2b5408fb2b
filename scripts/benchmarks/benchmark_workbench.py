"""How fast the workbench is: the real page in headless Chromium, on a copy of examples/hidden-backlash.

    .venv/bin/python scripts/benchmarks/benchmark_workbench.py            # all figures, some minutes
    .venv/bin/python scripts/benchmarks/benchmark_workbench.py --changes 50

Times are from the key press on a slider until the page shows the trace; the page's own clock takes them. A second
line says what was to be reached. The load average is printed, since other work on the machine counts.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import time

from workbench_page import Opened, slider_of

#: What was to be reached, s (rates: 1/s).
WANTED = {
    "start to first picture": 5.0,
    "slider to drives alone": 0.15,
    "slider to multibody, shown test": 0.5,
    "slider to multibody, all tests": 4.0,
}
#: Runs in the page: press a key and measure until the plot has moved, and until it says multibody.
PRESS = """async key => {
  const thumb = document.querySelector('.detail .q-slider [tabindex="0"]'); thumb.focus();
  const drawn = () => document.querySelector('svg.polar path.simulated').getAttribute('d');
  const engine = () => document.querySelector('.traces-head .soft').textContent;
  const chip = () => document.querySelector('.chip').textContent;
  const was = drawn(), out = {};
  const until = async done => { const limit = performance.now() + 60000;
    while (!done()) { if (performance.now() > limit) return NaN; await new Promise(r => setTimeout(r, 5)); }
    return (performance.now() - begin) / 1000; };
  const begin = performance.now();
  thumb.dispatchEvent(new KeyboardEvent('keydown', {key, keyCode: key == 'ArrowRight' ? 39 : 37, bubbles: true}));
  thumb.dispatchEvent(new KeyboardEvent('keyup', {key, keyCode: key == 'ArrowRight' ? 39 : 37, bubbles: true}));
  out.drives = await until(() => drawn() != was);
  out.shown = await until(() => engine().startsWith('multibody'));
  out.all = await until(() => chip() == 'multibody' && engine().startsWith('multibody'));
  return out; }"""
#: Counts the pictures that the browser draws in 4 s.
FRAMES = """async () => { let n = 0, end = performance.now() + 4000;
  const real = WebGL2RenderingContext.prototype.clear;
  WebGL2RenderingContext.prototype.clear = function (...a) { n++; return real.apply(this, a); };
  while (performance.now() < end) await new Promise(r => setTimeout(r, 50));
  WebGL2RenderingContext.prototype.clear = real; return n / 4; }"""


def memory(pid: int) -> float:
    """Resident memory of a process, MB."""
    with open(f"/proc/{pid}/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--changes", type=int, default=500, help="changes of the model over which memory is watched")
    parser.add_argument("--rounds", type=int, default=10, help="slider moves that are timed")
    options = parser.parse_args()
    print(f"load average at the start {os.getloadavg()[0]:.1f} on {len(os.sched_getaffinity(0))} cores")
    with Opened() as opened:
        opened.page.wait_for_selector("svg.polar path.measured")
        report("start to first picture", time.monotonic() - opened.started)
        opened.until("document.querySelector('.chip')?.textContent == 'multibody'")
        slider_of(opened, "A", "backlash.A")
        print("while the bars of the effects are computed:")
        time_slider(opened, options.rounds)
        opened.until("!document.body.textContent.includes('computing the bars')")
        opened.settled()
        print("after that:")
        time_slider(opened, options.rounds)
        opened.page.wait_for_timeout(5000)  # the bars of the last model
        opened.page.keyboard.press("Escape")
        opened.page.locator("button[aria-label='Play']").click()
        opened.page.wait_for_timeout(500)
        opened.poses, begin = 0, time.monotonic()
        frames = opened.page.evaluate(FRAMES)
        print(f"frames a second in the browser while playing: {frames:.1f} (wanted: 5)")
        print(f"poses a second from the server: {opened.poses / (time.monotonic() - begin):.1f} (wanted: 30)")
        opened.page.locator("button[aria-label='Play']").click()
        watch_memory(opened, options.changes)
    print(f"load average at the end {os.getloadavg()[0]:.1f}")
    return 0


def time_slider(opened: Opened, rounds: int) -> None:
    """Print how long the page takes to show a move of the slider, from the key to the trace."""
    rows = [opened.page.evaluate(PRESS, "ArrowRight" if k % 2 else "ArrowLeft") for k in range(rounds)]
    for key, name in (("drives", "drives alone"), ("shown", "multibody, shown test"), ("all", "multibody, all tests")):
        report(f"slider to {name}", statistics.median(r[key] for r in rows), max(r[key] for r in rows))


def report(name: str, value: float, worst: float | None = None) -> None:
    """Print one figure."""
    most = f", worst {worst:.2f} s" if worst is not None else ""
    print(f"{name}: {value:.2f} s{most} (wanted: {WANTED[name]:g} s)", flush=True)


def watch_memory(opened: Opened, changes: int) -> None:
    """Print the server's memory before and after many changes, of which every fifth is simulated to the end."""
    thumb = opened.page.locator(".detail .q-slider [tabindex='0']").first
    marks = []
    for k in range(changes):
        thumb.press("ArrowRight" if (k // 40) % 2 else "ArrowLeft")
        opened.page.wait_for_timeout(600 if k % 5 == 0 else 60)
        if k in (changes // 5, changes - 1):
            marks.append(memory(opened.process.pid))
    first, last = marks[0], marks[-1]
    print(f"memory of the server after {changes // 5} and {changes} changes: {first:.0f} and {last:.0f} MB")


if __name__ == "__main__":
    sys.exit(main())
