"""Results that are kept on disk: by content, never an old one, within a size, whatever happens to the files."""

import os
import pickle
import threading
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from commands import ok

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.effects.registry import make
from mjsim.inference.fit import Fitter
from mjsim.inference.problem import Problem
from mjsim.inference.signatures import SignatureBank, seeds
from mjsim.io import cache
from mjsim.machine.model import build
from mjsim.simulation import readings
from mjsim.simulation.readings import readings_of


@pytest.fixture
def kept(tmp_path):
    with cache.cached(tmp_path / "cache") as store:
        yield store


def counted(value):
    """A function that counts how often it is called."""

    def make_it():
        make_it.calls += 1
        return value

    make_it.calls = 0
    return make_it


def test_the_same_content_is_computed_once(kept):
    work = counted({"a": 1})
    for _ in range(3):
        assert cache.remembered("diagnoses", lambda: ("x", 1.0), work) == {"a": 1}
    assert work.calls == 1 and kept.hits["diagnoses"] == 2
    cache.remembered("diagnoses", lambda: ("x", np.nextafter(1.0, 2.0)), work)
    assert work.calls == 2


def test_nothing_is_kept_outside_of_the_block(tmp_path):
    work = counted(1)
    for _ in range(2):
        cache.remembered("diagnoses", lambda: ("x",), work)
    with cache.cached(tmp_path, wanted=False) as store:
        assert store is None
        cache.remembered("diagnoses", lambda: ("x",), work)
    assert work.calls == 3 and list(tmp_path.iterdir()) == []


def test_it_can_be_switched_off(tmp_path, monkeypatch):
    monkeypatch.setenv("MJSIM_CACHE", "off")
    with cache.cached() as store:
        assert store is None
    monkeypatch.setenv("MJSIM_CACHE", str(tmp_path / "here"))
    with cache.cached() as store:
        assert store.folder == tmp_path / "here"
    assert cache.store() is None


@pytest.mark.parametrize("spoil", [b"", b"nonsense", None])
def test_a_damaged_file_is_computed_again(kept, spoil):
    work = counted(np.arange(5.0))
    first = cache.remembered("readings", lambda: (1,), work)
    (file,) = (kept.folder / "readings").iterdir()
    if spoil is None:
        file.write_bytes(pickle.dumps(os.getcwd))  # never loaded: arrays are no pickles
    else:
        file.write_bytes(spoil)
    again = cache.remembered("readings", lambda: (1,), work)
    assert work.calls == 2 and np.array_equal(first, again)


def test_the_folder_keeps_to_its_size(tmp_path):
    with cache.cached(tmp_path, limit_mb=1.0) as store:
        for i in range(8):
            cache.remembered("readings", lambda i=i: (i,), lambda: np.zeros(10_000))
            for file in (tmp_path / "readings").iterdir():
                os.utime(file, (file.stat().st_mtime - 10, file.stat().st_mtime - 10))
        files = list((tmp_path / "readings").iterdir())
        assert 0 < sum(f.stat().st_size for f in files) <= cache.SHARES["readings"] * 1e6
        work = counted(np.zeros(10_000))
        cache.remembered("readings", lambda: (7,), work)  # the newest is still there, the oldest is not
        cache.remembered("readings", lambda: (0,), work)
        assert work.calls == 1 and store.hits["readings"] == 1


def test_several_writers_do_not_hurt_each_other(kept):
    errors = []

    def work(i):
        try:
            for j in range(20):
                got = cache.remembered("readings", lambda j=j: (j,), lambda j=j: np.full(1000, float(j)))
                assert got[0] == j and len(got) == 1000
        except BaseException as error:
            errors.append(error)

    threads = [threading.Thread(target=work, args=(i,)) for i in range(6)]
    for t in threads:
        t.start()
    for t in threads:
        t.join()
    assert not errors
    assert len(list((kept.folder / "readings").iterdir())) == 20


def test_a_folder_that_cannot_be_written_is_no_failure(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with cache.cached(tmp_path / "file" / "cache") as store:
        assert store is None
        assert cache.remembered("diagnoses", lambda: (1,), lambda: 5) == 5


def test_what_has_no_fingerprint_is_not_kept(kept):
    class Mine:
        pass

    work = counted(1)
    for _ in range(2):
        cache.remembered("diagnoses", lambda: (Mine(),), work)
    assert work.calls == 2
    with pytest.raises(TypeError, match="no fingerprint"):
        cache.fingerprint(lambda: 1)


def test_a_fingerprint_sees_every_change(m1, circle):
    test = circle("XY", (0, 0, 155))
    prints = [
        cache.fingerprint(build(m1), test),
        cache.fingerprint(build(m1.with_effect(make("backlash.A", width_deg=0.001))), test),
        cache.fingerprint(build(m1.with_drive("X", position_gain=44.0)), test),
        cache.fingerprint(build(m1), replace(test, feed=test.feed * 1.0001)),
        cache.fingerprint(np.zeros(3)),
        cache.fingerprint(np.zeros((3, 1))),
        cache.fingerprint(np.zeros(3, np.float32)),
        cache.fingerprint("ab", "c"),
        cache.fingerprint("a", "bc"),
    ]
    assert len(set(prints)) == len(prints)
    assert cache.fingerprint(build(m1), test) == prints[0]


def test_readings_from_the_cache_are_the_simulated_ones(m1, circle, kept, monkeypatch):
    tests = [circle("XY", (0, 0, 155), feed=5000.0), circle("YZ", (0, 0, 155), feed=5000.0)]
    first = readings_of(m1, tests[:1])
    told = []
    both = readings_of(m1, tests, done=lambda t: told.append(t.name))
    assert np.array_equal(first[0].deviation, both[0].deviation) and len(told) == 2
    monkeypatch.setattr(readings, "simulate_each", lambda *_: pytest.fail("simulated again"))
    again = readings_of(build(m1), tests)
    for a, b in zip(both, again, strict=True):
        assert a.test == b.test and np.array_equal(a.deviation, b.deviation)


def test_signatures_from_the_cache_are_the_computed_ones(good, kept, monkeypatch):
    campaign = read_campaign(good)
    machine = read_machine(campaign.machine_file)
    problem = Problem.of(campaign, build(machine))
    fit = Fitter(problem, machine).fit([], exact=False)
    candidates = seeds(machine)[:6]
    one, other = SignatureBank(problem, fit), SignatureBank(problem, fit)
    one.compute(candidates)
    monkeypatch.setattr(SignatureBank, "columns_of", lambda *_: pytest.fail("computed again"))
    other.compute(candidates)
    assert one.matrix.any() and np.array_equal(one.matrix, other.matrix) and one.slices == other.slices
    with pytest.raises(BaseException, match="computed again"):
        other.compute(candidates[:3])


def test_a_second_diagnosis_is_taken_from_the_cache(good, tmp_path, monkeypatch):
    monkeypatch.setenv("MJSIM_CACHE", str(tmp_path / "cache"))
    first = ok("diagnose", good, "--as-is", "--json")
    again = ok("diagnose", good, "--as-is", "--json")
    assert first.stdout == again.stdout
    assert "taken from the cache" in ok("diagnose", good, "--as-is").stderr
    assert "taken from the cache" not in ok("diagnose", good, "--as-is", "--no-cache").stderr
    assert "taken from the cache" not in ok("diagnose", good, "--as-is", "--max-effects", "2").stderr


def test_how_long_it_will_take_is_known_from_the_last_time(kept, capsys):
    from mjsim.cli.diagnose import say_how_long

    campaign = SimpleNamespace(traces={"a": SimpleNamespace(time=np.array([0.0, 100.0]))}, measured=["a"])
    campaign.of = lambda instrument: campaign
    done = say_how_long(campaign)
    assert capsys.readouterr().err == ""
    done()
    assert kept.seconds("diagnose") < 0.1
    kept.took("diagnose", 0.3)
    say_how_long(campaign)
    assert "a diagnosis of 1 test takes about 30 s" in " ".join(capsys.readouterr().err.split())


def test_changed_code_is_other_code(tmp_path, monkeypatch):
    """Of the same version: a checkout changes file by file."""
    file = tmp_path / "room" / "module.py"
    file.parent.mkdir()
    file.write_text("x = 1\n")
    monkeypatch.setattr(cache.mjsim, "__file__", str(tmp_path / "__init__.py"))
    before = cache.code.__wrapped__()
    assert cache.code.__wrapped__() == before
    os.utime(file, ns=(file.stat().st_atime_ns, file.stat().st_mtime_ns + 1000))
    changed = cache.code.__wrapped__()
    (file.parent / "other.py").write_text("")
    assert len({before, changed, cache.code.__wrapped__()}) == 3
