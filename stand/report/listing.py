"""The catalogues as rows: what `stand list` shows."""

from collections.abc import Callable

from stand import catalogue


def listing(what: str) -> list[dict[str, str | float | None]]:
    """Entries of 'procedures', 'imus', 'tables' or 'methods', one dictionary per row."""
    makers: dict[str, Callable[[], list[dict[str, str | float | None]]]] = {
        "procedures": _procedures,
        "imus": _imus,
        "tables": _tables,
        "methods": _methods,
    }
    return makers[what]()


def _procedures() -> list[dict[str, str | float | None]]:
    from stand.procedure import Dwell, load_procedure

    rows: list[dict[str, str | float | None]] = []
    for name in catalogue.ids("procedures"):
        entry = load_procedure(name).entry
        dwells = [step.duration_s for step in entry.step if isinstance(step, Dwell)]
        rows.append(
            {
                "id": name,
                "title": entry.title,
                "dwells": len(dwells),
                "rest_s": sum(dwells),
                "estimates": ", ".join(entry.estimate.methods),
            }
        )
    return rows


def _imus() -> list[dict[str, str | float | None]]:
    from stand.imu import Stated, load_imu

    def value(stated: Stated | None) -> float | None:
        return None if stated is None else stated.value

    rows: list[dict[str, str | float | None]] = []
    for name in catalogue.ids("imus"):
        entry = load_imu(name).entry
        rows.append(
            {
                "id": name,
                "title": entry.title,
                "grade": entry.grade,
                "evidence": entry.evidence,
                "bias deg/h": value(entry.gyro.turn_on_bias_deg_h),
                "ARW deg/rt-h": value(entry.gyro.angle_random_walk_deg_rt_h),
                "bias mg": value(entry.accel.turn_on_bias_mg),
                "VRW m/s/rt-h": value(entry.accel.velocity_random_walk_m_s_rt_h),
            }
        )
    return rows


def _tables() -> list[dict[str, str | float | None]]:
    from alignment.units import DEG
    from stand.table import load_table

    return [
        {
            "id": name,
            "title": (table := load_table(name)).title,
            "gimbal rate deg/s": f"{table.rate[3:].min() / DEG:g}",
            "base travel deg": f"{table.low[0] / DEG:g} to {table.high[0] / DEG:g}",
        }
        for name in catalogue.ids("tables")
    ]


def _methods() -> list[dict[str, str | float | None]]:
    from alignment import ESTIMATORS

    return [
        {
            "id": name,
            "title": method.title,
            "needs latitude": "yes" if method.needs_latitude else "no",
            "source": method.source,
        }
        for name, method in ESTIMATORS.items()
    ]
