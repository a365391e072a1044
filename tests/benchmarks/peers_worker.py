"""One side of `peers`: jobs from standard input, each timed, by this project or by another.

Runs in either environment; each job imports what it needs before its clock starts. A line of JSON
in: ``{"job": ..., ...}``; a line out: wall and processor seconds, samples, more.
"""

import json
import sys
import time

import numpy as np

DEG = np.pi / 180
# the same errors on both sides: bias, scale factor, white noise and random walk of the bias
ARW, VRW = 0.003 * DEG / 60, 0.03 / 60  # rad/rt-s, m/s/rt-s
GYRO_BIAS, ACCEL_BIAS = 0.01 * DEG / 3600, 1e-3  # rad/s, m/s^2
GYRO_WALK, ACCEL_WALK = 0.01 * DEG / 3600 / 60, 1e-5 / 60  # rad/s, m/s^2 per root second


class Clock:
    """Wall and processor seconds of what stands in its block."""

    def __enter__(self):
        self.wall, self.cpu = time.perf_counter(), time.process_time()
        return self

    def __exit__(self, *error):
        self.wall, self.cpu = time.perf_counter() - self.wall, time.process_time() - self.cpu

    def told(self, samples, **more):
        return {"wall": self.wall, "cpu": self.cpu, "samples": int(samples), **more}


# --- this project --------------------------------------------------------------------------------


def ours(procedure, unit, rate, seed=0, save=None):
    """A run in memory: samples with errors, truth, attitudes."""
    import stand

    settings = stand.settings(procedure, imu=unit, rate_hz=rate, seed=seed)
    with Clock() as clock:
        run = stand.simulate(settings)
    if save is not None:
        np.savez(save, t=run.t, q=run.q_nb, dw=run.true_w_ib_b / rate)
    return clock.told(len(run))


def ours_mcap(path, n):
    from stand.recording.mcap.writer import write_imu_log

    t, w, f = _readings(n)
    with Clock() as clock:
        write_imu_log(path, t_ns=t, w_ib_b=w, f_b=f, metadata={})
    return clock.told(n)


def ours_allan(n):
    from alignment.allan.deviation import deviation

    signal = np.random.default_rng(0).standard_normal(n)
    with Clock() as clock:
        curve = deviation(signal, 0.005)
    return clock.told(n, m=curve.m.tolist(), deviation=np.sqrt(curve.variance).tolist())


# --- others --------------------------------------------------------------------------------------


def pyins_attitudes(attitudes, rate, save=None):
    """The same attitudes as increments of pyins, with the same errors."""
    from pyins import sim
    from scipy.spatial.transform import Rotation

    with np.load(attitudes) as saved:
        t = saved["t"]
        rph = Rotation.from_quat(saved["q"]).as_euler("xyz", degrees=True)
    lla = np.resize([48.5, 0.0, 0.0], (len(t), 3))
    with Clock() as clock:
        trajectory, imu = sim.generate_imu(t, lla, rph, np.zeros((len(t), 3)), "increment")
        _pyins_errors(imu)
    _keep(save, trajectory, imu)
    return clock.told(len(t))


def pyins_turntable(rate, rest, save=None):
    """Six positions of its turntable; see `turning` of `peers` for ours."""
    from pyins import sim

    with Clock() as clock:
        table = sim.Turntable([48.5, 0.0, 0.0], angular_rate=60, angular_acceleration=60)
        for axis, angle in (("outer", 90), ("inner", 90), ("outer", 90), ("inner", 90)):
            table.rest(rest)
            table.rotate(axis, angle)
        table.rest(rest)
        trajectory, imu, _ = table.generate_imu(1 / rate, "increment")
        _pyins_errors(imu)
    _keep(save, trajectory, imu)
    return clock.told(len(imu), seconds=float(table.time))


def _pyins_errors(imu):
    from pyins import inertial_sensor as sensor

    for columns, bias, noise, walk in (
        (sensor.GYRO_COLS, GYRO_BIAS, ARW, GYRO_WALK),
        (sensor.ACCEL_COLS, ACCEL_BIAS, VRW, ACCEL_WALK),
    ):
        model = sensor.EstimationModel(bias, noise, walk, 1e-5 * np.eye(3))
        sensor.Parameters.from_EstimationModel(model, 0).apply(imu[columns], "increment")


def _keep(save, trajectory, imu):
    if save is not None:
        from scipy.spatial.transform import Rotation

        rph = trajectory[["roll", "pitch", "heading"]].to_numpy()
        q = Rotation.from_euler("xyz", rph, degrees=True).as_quat()
        dw = imu[["gyro_x", "gyro_y", "gyro_z"]].to_numpy()
        np.savez(save, t=np.asarray(imu.index), q=q, dw=dw)


def ahrs_attitudes(attitudes, rate, save=None):
    """The same attitudes by ahrs: nine channels, white noise, an Earth that does not turn."""
    import ahrs

    with np.load(attitudes) as saved:
        t, q = saved["t"], np.roll(saved["q"], 1, axis=1)
    with Clock() as clock:
        made = ahrs.Sensors(quaternions=q, freq=rate, gyr_noise=1e-4, acc_noise=1e-3)
    if save is not None:
        np.savez(save, t=t, q=np.roll(q, -1, axis=1), dw=made.ang_vel / rate)
    return clock.told(len(t))


def mcap_writer(path, n):
    """Bytes that are ready, by the `mcap` library itself: what any encoder must add to."""
    from mcap.writer import CompressionType, Writer

    t, w, f = _readings(n)
    body = np.zeros((n, 324), np.uint8)
    body[:, 120:168] = np.hstack([w, f]).view(np.uint8)
    with Clock() as clock, open(path, "wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library="peers")
        schema = writer.register_schema("sensor_msgs/msg/Imu", "ros2msg", b"")
        channel = writer.register_channel("/imu/data", "cdr", schema)
        for stamp, row in zip(t.tolist(), body, strict=True):
            writer.add_message(channel, stamp, row.tobytes(), stamp)
        writer.finish()
    return clock.told(n)


def allantools(n):
    import allantools as at

    signal = np.random.default_rng(0).standard_normal(n)
    with Clock() as clock:
        tau, deviation, _, _ = at.oadev(signal, rate=200.0, data_type="freq", taus="octave")
    return clock.told(n, m=np.rint(tau * 200).tolist(), deviation=deviation.tolist())


def _readings(n):
    rng = np.random.default_rng(0)
    w, f = rng.standard_normal((2, n, 3)) * 1e-3 + [[[0, 5e-5, 5e-5]], [[0, 9.81, 0]]]
    return np.arange(1, n + 1) * 5_000_000, w, f


JOBS = {
    job.__name__: job
    for job in (
        *(ours, ours_mcap, ours_allan, pyins_attitudes, pyins_turntable),
        *(ahrs_attitudes, mcap_writer, allantools),
    )
}


def main() -> None:
    for line in sys.stdin:
        asked = json.loads(line)
        print(json.dumps(JOBS[asked.pop("job")](**asked)), flush=True)


if __name__ == "__main__":
    main()
