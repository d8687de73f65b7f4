"""Files as trackers, force sensors and robots write them, made from a few experiments of the example's campaign."""

import csv
import datetime
import shutil

import numpy as np
import yaml
from three_arms import KR270

KEPT = ("E01", "E02", "E03", "E04")
NAMES = {"P1": "Refl 1", "P2": "Refl 2", "P3": "Größe_3"}
JOINTS = [f"joint_{k}" for k in range(1, 7)]
START = datetime.datetime(2026, 3, 1, 8, 30)


def original():
    """Four experiments of the example's campaign: 4 x 7 steps x 3 points, 5 decimals of a millimetre."""
    with (KR270 / "measurements.csv").open() as stream:
        return [row for row in csv.DictReader(stream) if row["experiment"] in KEPT]


def measurements_text(rows):
    names = list(rows[0])
    return "\n".join([",".join(names), *(",".join(row[n] for n in names) for row in rows)]) + "\n"


def rows_of(folder):
    with (folder / "original.csv").open() as stream:
        return list(csv.DictReader(stream))


def write_map(folder, **content):
    content = {"cell": "cell.yaml", "plan": "PLAN.csv"} | content
    content = {key: value for key, value in content.items() if value is not None}
    (folder / "MAP.yaml").write_text(yaml.safe_dump(content, allow_unicode=True))
    return folder / "MAP.yaml"


def write_lines(path, lines, encoding="utf-8", end="\n"):
    path.write_bytes((end.join(lines) + end).encode(encoding))


def tracker_a(folder, rows=None):
    """Long table, semicolons and decimal commas, a preamble, cp1252, the tracker's own point names, a flag, mm."""
    lines = ["Lasertracker Protokoll", "Prüfer;Größe", "Messung;Stufe;Ziel;Zeit;X [mm];Y [mm];Z [mm];ok;", ";;;;;;;;"]
    for row in rows or rows_of(folder):
        xyz = [row[f"{a}_mm"].replace(".", ",") for a in "xyz"]
        lines.append(";".join([row["experiment"], row["step"], NAMES[row["point"]], row["time_s"], *xyz, "ja", ""]))
    write_lines(folder / "a.txt", lines, "cp1252", "\r\n")
    return {
        "file": "a.txt", "delimiter": ";", "decimal": ",", "encoding": "cp1252", "skip_lines": 2, "skip_after_header": 0,
        "unit": "mm", "columns": {"x": "X [mm]", "y": "Y [mm]", "z": "Z [mm]"},
        "point_column": "Ziel", "rename": {v: k for k, v in NAMES.items()}, "time": {"column": "Zeit"},
        "match": {"by": "columns", "experiment": "Messung", "step": "Stufe"},
        "drop": [{"column": "Ziel", "values": [""]}, {"column": "ok", "keep": ["ja"]}],
    }  # fmt: skip


def tracker_b(folder, rows=None):
    """Wide table in metres, blanks between cells, comments, no header, in the order driven; nothing but coordinates."""
    lines, line = ["# a wide export"], []
    for row in rows or rows_of(folder):
        line += [f"{float(row[f'{a}_mm']) / 1e3:.8f}" for a in "xyz"]
        if row["point"] == "P3":
            lines += ["   ".join(line), "# pause"]
            line = []
    write_lines(folder / "b.dat", lines)
    return {
        "file": "b.dat", "delimiter": "space", "comment": "#", "unit": "m",
        "header": [f"{p}_{a}" for p in NAMES for a in "XYZ"],
        "points": {p: {a: f"{p}_{a.upper()}" for a in "xyz"} for p in NAMES},
        "match": {"by": "order"},
    }  # fmt: skip


def tracker_c(folder, rows=None):
    """Long table with tabs, micrometres and dates; which step it was, time alone says."""
    lines = ["When\tTarget\tX\tY\tZ"]
    for row in rows or rows_of(folder):
        when = START + datetime.timedelta(seconds=float(row["time_s"]) + 1.25)
        xyz = [f"{float(row[f'{a}_mm']) * 1e3:.2f}" for a in "xyz"]
        lines.append("\t".join([when.isoformat(), row["point"], *xyz]))
    write_lines(folder / "c.tsv", lines)
    return {
        "file": "c.tsv", "delimiter": "tab", "unit": "um", "columns": {"x": "X", "y": "Y", "z": "Z"}, "point_column": "Target",
        "time": {"column": "When", "format": "iso"}, "match": {"by": "time", "how": "since", "window_s": 25},
    }  # fmt: skip


def force_log(folder, rows=None, *, turn=None, every=2.0, noise=0.0):
    """A log every two seconds while something is read: reaction forces in kN, the sensor's axes are other ones."""
    rng = np.random.default_rng(5)
    R = np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]])  # world = R sensor: the sensor's x, y, z are the world's y, z, x
    lines = ["clock;A;B;C"]
    for row in rows or rows_of(folder):
        force = -np.array([float(row[f"f{a}_N"]) for a in "xyz"])
        for late in np.arange(0.0, 6.0, every):
            when = START + datetime.timedelta(seconds=float(row["time_s"]) + late)
            sensor = R.T @ (force + rng.normal(scale=noise, size=3)) / 1e3
            lines.append(";".join([when.strftime("%H:%M:%S.%f"), *(f"{v:.7f}".replace(".", ",") for v in sensor)]))
    write_lines(folder / "f.log", lines)
    # R = Rz(90) Rx(90)
    return {
        "file": "f.log", "delimiter": ";", "decimal": ",", "unit": "kN", "sign": -1, "rpy_deg": [90, 0, 90] if turn is None else turn,
        "columns": {"fx": "A", "fy": "B", "fz": "C"}, "time": {"column": "clock", "format": "clock"},
        "match": {"by": "time", "how": "average", "window_s": 4},
    }  # fmt: skip


def make_folder(tmp_path):
    """A cell, and a plan whose rows stand in the order they were driven in, with the time every step began."""
    for name in ("cell.yaml", "kr270.urdf"):
        shutil.copy(KR270 / name, tmp_path)
    rows = sorted(original(), key=lambda row: float(row["time_s"]))
    (tmp_path / "original.csv").write_text(measurements_text(rows))
    names = ["experiment", "step", "time_s", *(f"{j}_deg" for j in JOINTS), "fx_N", "fy_N", "fz_N"]
    plan = [{n: row[n] for n in names} for row in rows if row["point"] == "P1"]
    (tmp_path / "PLAN.csv").write_text(measurements_text(plan))
    return tmp_path
