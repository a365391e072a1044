"""One unit simulated, calibrated, and corrected in other recordings: what is left is as told."""

import numpy as np
import pytest
from procedures import resting

import stand
from alignment import ImuReadings
from alignment.calibration import corrected_covariance
from stand.calibration.corrected import corrected
from stand.calibration.exports import exported

SEEDS = (4, 6)
RATE = 20
EARTH = 15.041067  # deg/h
DEG_H = np.pi / 180 / 3600
REST = resting(120)


def settings(procedure, seed, **more):
    return stand.settings(procedure, imu="stim300", rate_hz=RATE, seed=seed, **more)


@pytest.fixture(scope="module")
def units():
    """Each unit's calibration, of twelve edges without the table, and another run of it."""
    found = []
    for seed in SEEDS:
        edges = stand.simulate(settings("tumble-12", seed))
        unit = stand.calibrate(edges, hand_held=True, imu="stim300", gravity_sigma_m_s2=1e-6)
        found.append((unit, stand.simulate(settings("six-position", seed, true_table=True))))
    return found


def test_what_is_left_of_six_positions_is_what_the_sigmas_say(units):
    z, gains = [], []
    for unit, run in units:
        readings = corrected(unit, ImuReadings(run.t, run.w_ib_b, run.f_b))
        for dwell in run.stretches:
            own = (run.t > dwell.t_from) & (run.t <= dwell.t_to)
            truth = np.r_[run.true_w_ib_b[own].mean(axis=0), run.true_f_b[own].mean(axis=0)]
            raw = np.hstack([run.w_ib_b, run.f_b])[own]
            after = np.hstack([readings.w_ib_b, readings.f_b])[own].mean(axis=0) - truth
            P = corrected_covariance(unit.calibration, truth[:3], truth[3:])
            sigma = np.sqrt(P.diagonal() + raw.var(axis=0) / own.sum())
            z.append(after / sigma)
            gains.append(np.abs(raw.mean(axis=0) - truth) / sigma)
    z = np.array(z)
    # twelve attitudes of two units with nine constants a triad each: some 18 free numbers of 72,
    # whose mean square is 1 +- sqrt(2/18): three of that to either side, drift of biases beside it
    assert 0.25 < np.mean(z**2) < 2.0
    assert np.abs(z).max() < 4.5
    # along gravity, where no rotation in the case matters: 1.9 mg and 200 ppm before
    assert np.min(np.max(gains, axis=1)) > 20


def test_alignment_improves_as_predicted(units):
    """Tilt by 1.9 mg and 1 mrad, then by the 1 mrad that nobody without a table can tell."""
    for unit, run in units:
        before, after = stand.align(run, "triad"), stand.align(run, "triad", calibration=unit)
        pairs = zip(before.scores, after.scores, strict=True)
        for one, other in ((a, b) for a, b in pairs if a.estimate.covariance is not None):
            sigma = np.sqrt(other.estimate.covariance.diagonal())[:2]
            assert np.degrees(sigma) == pytest.approx([np.degrees(1e-3)] * 2, rel=0.05)
            was = np.sqrt(one.estimate.covariance.diagonal())[:2]
            assert np.degrees(was) == pytest.approx(
                [np.degrees(np.hypot(1.9e-3, 1e-3))] * 2, rel=0.1
            )
            tilts = other.error[[0, 2]]
            assert np.abs(tilts).max() < 4 * sigma.max()


def test_a_corrected_recording_reads_earth_and_gravity(units, tmp_path):
    """Norms, which no rotation in the case changes; the noise is the unit's own as it was."""
    unit, _ = units[0]
    (tmp_path / "rest.toml").write_text(REST)
    stand.run(settings(tmp_path / "rest.toml", SEEDS[0]), out=tmp_path / "rest")
    file = unit.save(tmp_path / "c.json")
    log = stand.apply(file, tmp_path / "rest", tmp_path / "corrected.mcap")
    raw = stand.read(tmp_path / "rest")
    rates = [np.linalg.norm(one.readings.w_ib_b.mean(axis=0)) / DEG_H for one in (raw, log)]
    assert abs(rates[1] - EARTH) < 4  # a bias of 1 deg/h an axis is left
    assert abs(rates[1] - EARTH) < abs(rates[0] - EARTH)
    forces = [np.linalg.norm(one.readings.f_b.mean(axis=0)) for one in (raw, log)]
    g = raw.site.gravity
    assert abs(forces[1] - g) < 4e-4  # 14 ug of bias, 13 ppm of scale: 4 sigma of 2e-4 and noise
    assert abs(forces[0] - g) > 4e-4
    before, after = (
        {(c.sensor, c.axis): c.deviation for c in stand.allan(path).analysis.channels}
        for path in (tmp_path / "rest", tmp_path / "corrected.mcap")
    )
    for channel, deviation in before.items():
        # scale factors of 500 ppm and what leaks between axes
        np.testing.assert_allclose(after[channel], deviation, rtol=5e-3)


def test_the_calibrated_unit_is_replayed(units, tmp_path):
    """A run of the exported preset has the constants that were found, within their sigmas."""
    unit, _ = units[0]
    (path,) = exported(unit, tmp_path / "unit.toml")
    again = stand.unit(str(path), rate_hz=RATE, seed=77)
    for sensor, errors in (("gyro", again.gyro_errors), ("accel", again.accel_errors)):
        own = [p for p in unit.calibration.parameters if p.key.sensor == sensor]
        bias = [p for p in own if p.key.term == "bias"]
        off = errors.bias - [p.value for p in bias]
        assert (np.abs(off) < 4 * np.array([p.sigma for p in bias])).all()
        assert off.any()


def test_a_preset_says_what_of_the_covariance_it_loses(units, tmp_path):
    """Sigmas of one cause: gyros against accelerometers as `calibration.json` has it, and apart."""
    unit, _ = units[0]
    (path,) = exported(unit, tmp_path / "unit.toml")
    said = path.read_text(encoding="utf-8").replace("\n#", "")
    c = unit.calibration
    known = [d.sigma for d in c.derived if d.quantity == "gyro_to_accel"]
    own = {p.key: p.sigma for p in c.parameters if p.key.term == "misalignment"}
    # of a rotation half the difference of two misalignments, of both triads: by hand
    apart = np.sqrt(sum(s**2 for s in own.values()) / 4 / 3)
    sizes = [f"{x / DEG_H:.2g}" for x in (np.sqrt(np.mean(np.square(known))), apart)]
    assert f"known against accelerometers to {sizes[0]} arcsec" in said
    assert f"they scatter by {sizes[1]};" in said
    assert float(sizes[1]) > 2 * float(sizes[0])  # the case's rotation, which nobody told
