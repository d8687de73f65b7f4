"""Tables of blind trials: confusion, power against the oracle, false alarms, abstentions, classes, held-out p-values.

Run: python examples/blind_trials/score.py FOLDER [--write] [--remark TEXT]      (--write also makes docs/blind_trials.md)
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

import numpy as np  # noqa: E402

from blind_trials.oracle import power  # noqa: E402
from blind_trials.records import Record, Truth, read_failures, read_records  # noqa: E402
from blind_trials.stands import STANDS  # noqa: E402

BANDS = ((1.0, 3.0), (3.0, 5.0), (5.0, 8.0), (8.0, 20.1), (20.1, 1e9))
OUTCOMES = ("found", "kind", "wrong", "abstained", "missed")
DOCUMENT = HERE.parents[1] / "docs" / "blind_trials.md"


def bounds(count: int, of: int, confidence: float = 0.95) -> tuple[float, float]:
    """Clopper-Pearson bounds of a share."""
    from scipy.stats import beta

    tail = (1 - confidence) / 2
    low = 0.0 if count == 0 else float(beta.ppf(tail, count, of - count + 1))
    return low, 1.0 if count == of else float(beta.ppf(1 - tail, count + 1, of - count))


def share(count: int, of: int) -> str:
    """A share with its bounds."""
    if of == 0:
        return "-"
    low, high = bounds(count, of)
    return f"{count}/{of} = {100 * count / of:.0f} % [{100 * low:.1f}, {100 * high:.1f}]"


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A Markdown table."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += ["| " + " | ".join(str(cell) for cell in row) + " |" for row in rows]
    return "\n".join(lines) + "\n"


Case = tuple[Record, Truth]


def visible(records: list[Record]) -> list[Case]:
    """Hidden effects that the catalogue knows and that can be seen at all."""
    return [(r, t) for r in records for t in r.hidden if t.known and t.sigma >= 0.9]


def band_of(t: Truth) -> int:
    """Which of `BANDS`."""
    return next((k for k, (low, high) in enumerate(BANDS) if low <= t.alone < high), 0)


def _band(k: int) -> str:
    low, high = BANDS[k]
    return f"{low:.0f} - {high:.0f}" if high < 1e6 else f"above {low:.0f}"


def class_ratios(cases: list[Case], noise: bool) -> list[float]:
    """Sizes of the classes that were said over the oracle's; with `noise` it counts what fits within noise as well."""
    return [len(r.entry_of(t) or ()) / len(r.class_of(t, noise)) for r, t in cases if t.name in r.likenesses]


def _mean(values: list[float]) -> str:
    return f"{np.mean(values):.2f}" if values else "-"


def headline(records: list[Record], cases: list[Case]) -> str:
    """What the tables say, in a few lines."""
    nothing = [r for r in records if r.plan == "none"]
    strong = [(r, t) for r, t in cases if t.alone >= 8]
    outside = [(r, t) for r in records for t in r.hidden if not t.known and r.outside(t) >= 5]
    lines = [
        f"Nothing hidden: a name in {share(sum(bool(r.wrong) for r in nothing), len(nothing))}.",
        f"Effects of 8 sigma and more: found {share(sum(r.outcome(t) == 'found' for r, t in strong), len(strong))}; a wrong name "
        f"instead in {sum(r.outcome(t) == 'wrong' for r, t in strong)}.",
        "Effects that the catalogue lacks, 5 sigma and more unlike anything that it has: a name without a warning in "
        f"{share(sum(r.verdict == 'explained' and not all(r.warned) for r, _ in outside), len(outside))}.",
        f"Classes are {_mean(class_ratios(cases, True))} times the oracle's on average, {_mean(class_ratios(strong, True))} times for effects "
        "of 8 sigma and more. Both count what correlates above 0.95 and what fits within noise, of which a weak effect has much; over what "
        f"correlates alone the ratios are {_mean(class_ratios(cases, False))} and {_mean(class_ratios(strong, False))}.",
    ]
    return "\n".join(f"- {line}" for line in lines) + "\n"


GLOSSARY = """*Found*: the true kind at the true place, alone or in the class that is named. *Kind*: the true kind elsewhere. *Abstained*: no name, but the
verdict says that a gap remains. *Missed*: called consistent. *Fitted data*: what is not held out; a test of several columns pays for each.
*Oracle's test of these very readings*: its statistic with the noise that this trial has, in one column, so the comparison is in pairs.
*Less chance*: the points apart with the luck of these readings taken out (that test is a control variate of known mean), and twice their
standard error. The oracle knows nothing of a second effect, which may leak into its test of the first.
A step that is named an outlier may have effects in its class; one that is hidden is found there.
"""


def confusion(cases: list[Case]) -> str:
    """What was said of effects of 8 sigma and more."""
    rows = []
    for kind in sorted({t.kind for _, t in cases}):
        own = [(r, t) for r, t in cases if t.kind == kind and t.alone >= 8]
        said = Counter(r.outcome(t) for r, t in own)
        others = Counter(e[0].split(" at ")[0] for r, t in own if r.entry_of(t) is None for e in r.wrong)
        names = ", ".join(f"{name} {n}" for name, n in others.most_common())
        rows.append([kind, len(own), *(said[o] for o in OUTCOMES), names])
    return table(["hidden (8 sigma and more)", "trials", *OUTCOMES, "said instead"], rows)


def power_table(cases: list[Case], label: str, key: str, paired: bool = False) -> str:
    """Share found against what the oracle finds: its power on average, and its test of one column on the readings of these trials.

    Parameters
    ----------
    paired
        Also the points apart with the luck of these readings taken out, where each case is a trial of its own.
    """
    from scipy.stats import norm

    rows = []
    groups: dict[str, list[Case]] = {}
    for r, t in cases:
        groups.setdefault(t.kind if key == "kind" else _band(band_of(t)), []).append((r, t))
    order = sorted(groups) if key == "kind" else [_band(k) for k in range(len(BANDS)) if _band(k) in groups]
    for name in order:
        own = groups[name]
        found = sum(r.outcome(t) == "found" for r, t in own)
        told = [power(t.alone, t.parameters, r.level) for r, t in own]
        kept = [power(t.alone * t.sigma_kept / t.sigma, t.parameters, r.level) for r, t in own]
        one = [power(t.alone * t.sigma_kept / t.sigma, 1, r.level) for r, t in own]
        same = [abs(t.z_kept) > norm.isf(r.level / 2) for r, t in own]
        rows.append(
            [
                name,
                share(found, len(own)),
                *(f"{100 * np.mean(p):.0f} %" for p in (kept, one, told)),
                f"{sum(same)}/{len(own)}",
                f"{100 * (found / len(own) - np.mean(kept)):+.0f}",
            ]
            + ([less_chance([r.outcome(t) == "found" for r, t in own], same, one, kept)] if paired else [])
        )
    head = [
        label,
        "found",
        "oracle, fitted data",
        "oracle of one column, fitted data",
        "oracle, all data",
        "oracle's test of these very readings",
        "points apart",
        *(["less chance"] if paired else []),
    ]
    return table(head, rows)


def less_chance(found: list[bool], same: list[bool], one: list[float], kept: list[float]) -> str:
    """Points between what was found and the oracle's power, with twice the standard error.

    The luck of these very readings is taken out: the oracle's test of one column on them is a control variate of known mean.
    """
    apart = np.array(found, float) - np.array(same, float) + np.array(one) - np.array(kept)
    if len(apart) < 2:
        return "-"
    return f"{100 * apart.mean():+.0f} +- {200 * apart.std(ddof=1) / np.sqrt(len(apart)):.0f}"


def false_alarms(records: list[Record]) -> str:
    """Names given where nothing is hidden, or beside what is."""
    nothing = [r for r in records if r.plan == "none"]
    rows = []
    for name, own in [
        ("nothing hidden", nothing),
        *((f"- {arm}", [r for r in nothing if r.arm == arm]) for arm in STANDS),
        *(
            (f"- {q}, {'links' if k else 'joints'}", [r for r in nothing if (r.quantity, r.links) == (q, k)])
            for q in ("displacement", "position")
            for k in (True, False)
        ),
        ("beside a true effect", [r for r in records if r.plan in ("one", "two", "strong")]),
    ]:
        if own:
            named = share(sum(bool(r.wrong) for r in own), len(own))
            rows.append([name, named, share(sum(r.verdict != "consistent" for r in own), len(own))])
    return table(["trials", "a name that is not true", "verdict other than consistent"], rows)


def unknown(records: list[Record]) -> str:
    """What was said of effects that the catalogue lacks."""
    rows = []
    cases = [(r, t) for r in records for t in r.hidden if not t.known]
    for kind in sorted({t.kind for _, t in cases}):
        for strong in (False, True):
            own = [(r, t) for r, t in cases if t.kind == kind and (r.outside(t) >= 5) == strong]
            if own:
                confident = sum(r.verdict == "explained" and not all(r.warned) for r, _ in own)
                warned = sum(r.verdict == "explained" and bool(r.said) and all(r.warned) for r, _ in own)
                partly = sum(r.verdict == "partly_explained" and bool(r.said) for r, _ in own)
                verdicts = Counter(r.verdict for r, _ in own)
                names = Counter(e[0].split(" at ")[0] for r, _ in own for e in r.said)
                rows.append(
                    [
                        f"{kind}, {'5 sigma and more unlike anything known' if strong else 'less'}",
                        len(own),
                        share(confident, len(own)),
                        warned,
                        partly,
                        ", ".join(f"{v} {n}" for v, n in verdicts.items()),
                        ", ".join(f"{v} {n}" for v, n in names.items()),
                    ]
                )
    return table(
        ["outside the catalogue", "trials", "named with confidence", "with a warning", "in part", "verdicts", "names"],
        rows,
    )


def classes(cases: list[Case]) -> str:
    """Sizes of classes against the oracle's, by kind and by visible size."""
    rows = []
    known = [(r, t) for r, t in cases if t.name in r.likenesses]
    groups = {kind: [(r, t) for r, t in known if t.kind == kind] for kind in sorted({t.kind for _, t in known})}
    groups |= {f"all, {_band(k)} sigma": [(r, t) for r, t in known if band_of(t) == k] for k in range(len(BANDS))}
    for name, own in {**groups, "all": known}.items():
        if own:
            said = np.mean([len(r.entry_of(t) or ()) for r, t in own])
            row = [name, len(own), f"{said:.2f}"]
            for noise in (True, False):
                row += [f"{np.mean([len(r.class_of(t, noise)) for r, t in own]):.2f}", _mean(class_ratios(own, noise))]
            rows.append(row)
    return table(["class of", "trials", "said", "oracle", "ratio", "oracle, correlation alone", "ratio"], rows)


def uniformity(records: list[Record]) -> str:
    """Held-out p-values where everything was explained rightly, and where nothing is hidden."""
    from scipy.stats import kstest

    rows = []
    for name, own in [
        ("explained, every name true", [r for r in records if r.verdict == "explained" and r.hidden and not r.wrong]),
        ("nothing hidden, consistent", [r for r in records if r.plan == "none" and r.verdict == "consistent"]),
    ]:
        p = np.array([r.p_after for r in own if r.p_after is not None])
        if p.size:
            rows.append([name, p.size, f"{p.mean():.2f}", f"{(p < 0.05).sum()}", f"{kstest(p, 'uniform').pvalue:.3f}"])
    return table(["held-out p-values", "trials", "mean", "below 0.05", "Kolmogorov-Smirnov p"], rows)


def untestable(cases: list[Case]) -> str:
    """Effects said to be untestable that could be seen."""
    wrong = [(r, t) for r, t in cases if t.name in r.untestable]
    rows = [[f"{r.plan} {r.seed}", r.arm, r.quantity, t.name, f"{t.sigma:.1f}"] for r, t in wrong]
    return table(["said to be untestable, yet visible", "arm", "quantity", "effect", "sigma"], rows)


def failures(records: list[Record]) -> str:
    """Every trial that went wrong from 8 sigma on, with what was said instead; false alarms too."""
    rows = []
    for r in records:
        bad = [t for t in r.hidden if t.known and t.alone >= 8 and r.outcome(t) != "found"]
        if bad or r.wrong:
            true = "; ".join(f"{t.name} {t.alone:.1f}" for t in r.hidden) or "nothing"
            base = f"{r.arm}, {r.quantity}, {'links' if r.links else 'joints'}"
            rows.append(
                [f"{r.plan} {r.seed}", base, true, r.verdict, "; ".join(" = ".join(e) for e in r.said) or "nothing"]
            )
    return table(["trial", "base model", "hidden (sigma)", "verdict", "said"], rows)


def report(records: list[Record], without_answer: Sequence[tuple[str, str]] = (), remark: str = "") -> str:
    """All tables.

    Parameters
    ----------
    remark
        How these trials were run, where that needs saying.
    without_answer
        Trials that broke off, and why (`records.read_failures`).
    """
    cases = visible(records)
    count = Counter(r.plan for r in records)
    seeds = {
        plan: (min(r.seed for r in records if r.plan == plan), max(r.seed for r in records if r.plan == plan))
        for plan in count
    }
    parts = [
        "# Blind trials\n",
        "Made by `examples/blind_trials/score.py` from campaigns of `examples/blind_trials/run.py` (or `as_study.py`); every number is theirs. The "
        "truths are the plants of `examples/plants/`, which share no code with the packages. A sigma is the root of the "
        "noncentrality that is left of an effect's signature after the base model is projected out, over all experiments. "
        "The oracle is told the true effect's regressors and tests them at the same level. Shares have 95 % "
        "Clopper-Pearson bounds.\n",
        headline(records, cases),
        GLOSSARY,
        table(["plan", "trials", "seeds"], [[p, n, f"{seeds[p][0]} - {seeds[p][1]}"] for p, n in count.items()]),
        *([f"{remark}\n"] if remark else []),
        "## Power\n",
        power_table(cases, "sigma", "band"),
        power_table([(r, t) for r, t in cases if len(r.hidden) == 1], "hidden alone", "kind", paired=True),
        power_table([(r, t) for r, t in cases if len(r.hidden) > 1], "hidden with another", "kind"),
        "## Confusion\n",
        confusion(cases),
        "## False alarms\n",
        false_alarms(records),
        "## Outside the catalogue\n",
        unknown(records),
        "## Classes\n",
        classes(cases),
        "## Untestable\n",
        untestable(cases),
        "## Held-out p-values\n",
        uniformity(records),
        "## Failures\n",
        failures(records),
        "## Without an answer\n",
        table(["trial", "reason"], without_answer) if without_answer else "None.\n",
    ]
    return "\n".join(parts)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--remark", default="", help="how these trials were run, where that needs saying")
    options = parser.parse_args()
    text = report(read_records(options.folder), read_failures(options.folder), options.remark)
    print(text)
    if options.write:
        DOCUMENT.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
