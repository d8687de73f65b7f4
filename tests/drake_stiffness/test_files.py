"""YAML that teaches, files that appear whole, JSON without NaN."""

import json
import os
import stat

import numpy as np
import pytest

from drake_stiffness.errors import InputError
from drake_stiffness.files import Document, json_text, read_yaml, sha256, write_whole


class Inner(Document):
    mass_kg: float
    names: tuple[str, ...] = ()


class Outer(Document):
    inner: Inner
    speed: float = 1.0


def read(tmp_path, text):
    path = tmp_path / "job.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_yaml(path, Outer, "a job")


@pytest.mark.parametrize(
    ("text", "value"), [("2.5e6", 2.5e6), ("1e3", 1e3), ("-3.E-2", -0.03), (".5", 0.5), ("7", 7.0), ("+1E+2", 100.0)]
)
def test_numbers_are_numbers_with_exponents_too(tmp_path, text, value):
    assert read(tmp_path, f"inner: {{mass_kg: {text}}}\n").inner.mass_kg == value


BAD = {
    "empty": (b"", ["empty", "a job"]),
    "zeros": (b"\0\0\0", ["empty"]),
    "unknown key": ("inner: {mass_kg: 1}\nspeeed: 2\n", ["speeed", "unknown key", "Did you mean 'speed'", "value 2"]),
    "wrong unit": ("inner: {mass_g: 1}\n", ["inner.mass_g", "Did you mean 'mass_kg'", "inner.mass_kg: missing"]),
    "missing": ("speed: 2\n", ["inner", "missing"]),
    "not a number": ("inner: {mass_kg: heavy}\n", ["inner.mass_kg", "found 'heavy'", "valid number"]),
    "nan": ("inner: {mass_kg: .nan}\n", ["inner.mass_kg", "nan", "finite"]),
    "inf": ("inner: {mass_kg: .inf}\n", ["inner.mass_kg", "inf", "finite"]),
    "twice": ("inner: {mass_kg: 1}\nspeed: 1\nspeed: 2\n", ["line 3", "'speed'", "twice"]),
    "syntax": ("inner: {mass_kg: 1\nspeed: [\n", ["line ", "column ", "not valid YAML"]),
    "a list": ("- 1\n- 2\n", ["found [1, 2]", "a job"]),
    "a word": ("hello\n", ["found 'hello'"]),
    "latin": (b"inner: {mass_kg: 1} # \xe4\n", ["byte 22", "UTF-8"]),
    "tag": ("inner: !!python/object:os.system {}\n", ["not valid YAML", "line 1"]),
    "list for a number": ("inner: {mass_kg: [1]}\n", ["inner.mass_kg", "found [1]"]),
    "impossible date": ("inner: {mass_kg: 2024-13-45}\n", ["job.yaml"]),
    "key that is a list": ("? [a, b]\n: 3\n", ["job.yaml"]),
    "yes for a number": ("inner: {mass_kg: yes}\n", ["inner.mass_kg", "True"]),
}


@pytest.mark.parametrize("name", list(BAD))
def test_what_is_wrong_with_yaml_is_said_with_file_key_value_and_remedy(tmp_path, name):
    text, words = BAD[name]
    with pytest.raises(InputError) as error:
        read(tmp_path, text)
    for word in ["job.yaml", *words]:
        assert word in str(error.value)


def test_a_file_that_is_not_there_or_is_a_folder_is_named(tmp_path):
    with pytest.raises(InputError, match=r"nowhere\.yaml: no such file; expected a job"):
        read_yaml(tmp_path / "nowhere.yaml", Outer, "a job")
    with pytest.raises(InputError, match="folder"):
        read_yaml(tmp_path, Outer, "a job")


def test_a_byte_order_mark_does_no_harm(tmp_path):
    assert read(tmp_path, b"\xef\xbb\xbfinner: {mass_kg: 2}\n").inner.mass_kg == 2


def test_a_file_appears_whole_or_not_at_all(tmp_path, monkeypatch):
    path = tmp_path / "out.json"
    path.write_text("old")

    def fails(*args):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", fails)
    with pytest.raises(InputError, match=r"out\.json: cannot be written \(No space"):
        write_whole(path, "new")
    monkeypatch.undo()
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["out.json"]
    write_whole(path, b"new")
    assert path.read_bytes() == b"new"
    with pytest.raises(InputError, match="folder exists"):
        write_whole(tmp_path / "no" / "out.json", "new")


def test_outputs_have_the_permissions_of_any_new_file(tmp_path):
    write_whole(tmp_path / "a", "x")
    (tmp_path / "b").write_text("x")
    assert stat.S_IMODE((tmp_path / "a").stat().st_mode) == stat.S_IMODE((tmp_path / "b").stat().st_mode)


def test_json_has_no_nan_and_no_infinity():
    content = {
        "a": np.array([1.0, np.nan]),
        "b": (np.float64(np.inf), -np.inf),
        "c": np.int64(3),
        4: True,
        "d": [None, "ü"],
    }
    text = json_text(content)
    assert json.loads(text) == {"a": [1.0, None], "b": [None, None], "c": 3, "4": True, "d": [None, "ü"]}
    assert "NaN" not in text
    assert text.endswith("}\n")


def test_numbers_in_json_come_back_bit_for_bit():
    values = np.random.default_rng(0).normal(size=50) * 10.0 ** np.arange(-25, 25)
    assert json.loads(json_text({"v": values}))["v"] == values.tolist()


def test_sha256_of_a_file(tmp_path):
    (tmp_path / "abc").write_text("abc")
    assert sha256(tmp_path / "abc").startswith("ba7816bf8f01cfea")
