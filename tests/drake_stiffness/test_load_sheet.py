"""The sheet of paper: what hangs where, in words of the shop."""

import html.parser
import re

import numpy as np
import pytest
from test_plan_program import read_plan, some_postures

from drake_stiffness.shop.load_sheet import load_sheet
from drake_stiffness.shop.load_words import direction_words, load_words
from drake_stiffness.shop.visiting_order import visiting_order

DOWN = np.array([0.0, 0.0, -9.81])


class Rows(html.parser.HTMLParser):
    """The cells of every table row, as text."""

    def __init__(self):
        super().__init__()
        self.rows, self.open = [], 0

    def handle_starttag(self, tag, attrs):
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")
            self.open += 1

    def handle_endtag(self, tag):
        if tag in ("td", "th"):
            self.open -= 1

    def handle_data(self, data):
        if self.open:
            self.rows[-1][-1] += data


def rows_of(page):
    reader = Rows()
    reader.feed(page)
    return reader.rows


@pytest.mark.parametrize(
    ("force", "words"),
    [
        ((0, 0, -1), "down"),
        ((0, 0, 2), "up"),
        ((3, 0, 0), "+x"),
        ((0, -3, 0), "-y"),
        ((3, 4, 0), "level, 53 deg from +x to +y"),
        ((-3, 4, 0), "level, 37 deg from +y to -x"),
        ((1, 0, -1), "45 deg below level, +x"),
        ((0, 1, 1), "45 deg above level, +y"),
    ],
)
def test_directions_are_said_in_words(force, words):
    assert direction_words(np.array(force, dtype=float), DOWN) == words


def test_down_is_where_gravity_pulls():
    """A robot that hangs from the ceiling has its base's z pointing down."""
    assert direction_words(np.array([0, 0, 1.0]), -DOWN) == "down"
    assert direction_words(np.array([0, 0, 1.0]), np.zeros(3)) == "+z"
    assert direction_words(np.array([0, 0.6, 0.8]), np.array([-9.81, 0, 0])) == "along (0.000, 0.600, 0.800)"


def test_newtons_are_kilograms_of_the_cells_gravity():
    assert load_words(np.array([0, 0, -98.1, 0, 0, 0]), DOWN) == "98.1 N (10 kg) down"
    assert load_words(np.array([0, 0, -98.1, 0, 0, 0]), DOWN / 2) == "98.1 N (20 kg) down"
    assert load_words(np.array([0, 0, 0, 0, 50.0, 0]), DOWN) == "50 N m about +y"
    assert load_words(np.zeros(6), DOWN) == "no load"


def test_a_load_whose_components_a_plan_has_rounded_is_the_load_that_was_asked_for():
    slanting = np.round(60 * np.array([np.sqrt(0.5), np.sqrt(0.5), 0, 0, 0, 0]), 3)
    assert load_words(slanting, DOWN) == "60 N (6.116 kg) level, 45 deg from +x to +y"
    assert load_words(np.array([0, 0, -12536.25, 0, 0.004, 0]), DOWN).startswith("12536.25 N (1278 kg) down, 0.004 N m")


@pytest.fixture
def sheet(tmp_path, arms, cells):
    arm, cell = arms["kr270"], cells["kr270"]
    m = read_plan(tmp_path, arm, cell, some_postures(arm, 4) + [0, -70, 60, 0, 0, 0], ["A<b>", "B", "C", "D"])
    return load_sheet(m, arm, "My plan & more", np.array([2, 0, 3, 1])), m


def test_every_step_has_a_row_with_load_and_a_box_in_the_order_driven(sheet):
    page, m = sheet
    rows = rows_of(page)
    assert rows[0] == ["step", "load, N", "hang, kg", "direction (world axes)", "done", "time", "temp. °C", "remarks"]
    heads = [row[0] for row in rows[1:] if len(row) == 1]
    assert [re.match(r"C|A<b>|D|B", head)[0] for head in heads] == ["C", "A<b>", "D", "B"]
    assert f"A1 {np.degrees(m.cases.q[0, 6]):.2f}°" in heads[0]
    assert "(2 of 4)" in heads[1]
    steps = [row for row in rows[1:] if len(row) == 8]
    assert len(steps) == m.cases.number
    assert [row[:4] for row in steps[:3]] == [
        ["0", "0", "0", "no load"],
        ["1", "1250", "127.4", "down"],
        ["2", "500", "50.97", "level, 37° from -y to +x"],
    ]
    assert page.count('class="box"') == m.cases.number


def test_the_page_asks_nothing_of_any_other_file_and_escapes_names(sheet):
    page, _ = sheet
    assert "My plan &amp; more" in page
    assert "A&lt;b&gt;" in page
    assert not re.search(r"(src|href)=|url\(|@import", page)
    assert "size: A4" in page


def test_a_planned_time_stands_on_the_sheet(tmp_path, arms, cells):
    arm, cell = arms["track"], cells["track"]
    m = read_plan(tmp_path, arm, cell, some_postures(arm, 2), time_s=[600, 300])
    page = load_sheet(m, arm, "plan", visiting_order(m, arm.prismatic, "plan"))
    assert page.index("(300 s)") < page.index("(600 s)")
    assert re.search(r"E1 -?\d+\.\d\d mm", page)
