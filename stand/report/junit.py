"""A rehearsal as JUnit XML: build servers show it beside unit tests.

One test case per requirement, one per step, and one per prediction that runs were set beside. A
requirement that fails, and one of which nobody can say whether it holds, are failures: `stand
rehearse` ends with 1 for both, and a build must not go on without knowing. They are told apart by
the failure's type, FAIL or INDETERMINATE. A prediction that the runs contradict is a failure of
the type `contradicted`; then the first case of all is the verdict, a failure of the type
CONTRADICTED.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from stand.rehearsal.result import (
    FROM_SHEET,
    Finding,
    Judgement,
    Rehearsal,
    Severity,
    StepFeasibility,
    Verdict,
)
from stand.rehearsal.verification import Achieved, Verification
from stand.report.document import method_text
from stand.report.verified import outcome
from stand.report.wording import (
    achieved_in_words,
    judged_in_words,
    limit_text,
    margin_in_words,
    refused_in_words,
)


def junit(result: Rehearsal) -> str:
    """The XML text, with its declaration."""
    name = result.inputs.procedure
    suites = Element("testsuites", name="stand rehearse")
    for title, cases in (
        ("verdict", _verdict(name, result)),
        ("requirements", [_required(name, j) for j in result.judgements]),
        ("steps", [_step(name, step) for step in result.feasibility]),
        ("findings", [_finding(name, k, f) for k, f in enumerate(_errors(result), start=1)]),
    ):
        if cases:
            suites.append(_suite(result, f"{name}.{title}", cases))
    if result.verification is not None:
        suites.append(_verified(result, result.verification))
    for key in ("tests", "failures"):
        suites.set(key, str(sum(int(suite.get(key, "0")) for suite in suites)))
    suites.set("time", f"{sum(float(suite.get('time', '0')) for suite in suites):.3f}")
    indent(suites)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + tostring(suites, "unicode") + "\n"


def _verdict(name: str, result: Rehearsal) -> list[Element]:
    """Said first where the runs contradict the predictions; otherwise it is that of the cases."""
    if result.verdict is not Verdict.CONTRADICTED or result.verification is None:
        return []
    told = outcome(result.verification)
    return [_case(f"{name}.verdict", "verdict", (result.verdict.value, told), told)]


def _errors(result: Rehearsal) -> list[Finding]:
    return [f for f in result.findings if f.severity is Severity.ERROR]


def _verified(result: Rehearsal, v: Verification) -> Element:
    """What the runs were compared with; how many there were, and who gave no answer in them."""
    name = f"{result.inputs.procedure}.verification"
    cases = [_compared(name, a) for a in v.achieved if a.ratio is not None]
    known = {"runs": str(v.done), "runs asked": str(v.requested), "seed": str(v.seed)}
    suite = _suite(result, name, cases, v.seconds, known)
    if v.refused:
        refusals = "\n".join(refused_in_words(r, v.done) for r in v.refused)
        SubElement(suite, "system-out").text = _clean(refusals)
    return suite


def _suite(
    result: Rehearsal,
    name: str,
    cases: list[Element],
    seconds: float = 0.0,
    more: Mapping[str, str] = MappingProxyType({}),
) -> Element:
    failures = sum(case.find("failure") is not None for case in cases)
    suite = Element(
        "testsuite",
        name=_clean(name),
        tests=str(len(cases)),
        failures=str(failures),
        errors="0",
        skipped="0",
        time=f"{seconds:.3f}",
    )
    properties = SubElement(suite, "properties")
    i = result.inputs
    known: dict[str, str] = {"procedure": i.procedure, "imu": i.imu, "table": i.table} | {
        f"sha256 {key}": value for key, value in i.sha256.items()
    }
    sheet = [f.text for f in result.findings if f.kind == FROM_SHEET]
    known |= {f"unstated {k}": text for k, text in enumerate(sheet, start=1)}
    known |= more
    for key, value in known.items():
        SubElement(properties, "property", name=_clean(key), value=_clean(value))
    suite.extend(cases)
    return suite


def _case(group: str, name: str, failure: tuple[str, str] | None, text: str) -> Element:
    """A test case; `failure` is its type and message."""
    case = Element("testcase", classname=_clean(group), name=_clean(name), time="0")
    if failure is not None:
        kind, message = failure
        SubElement(case, "failure", type=kind, message=_clean(message)).text = _clean(text)
    else:
        SubElement(case, "system-out").text = _clean(text)
    return case


def _required(procedure: str, j: Judgement) -> Element:
    told = judged_in_words(j)
    failure = None if j.verdict is Verdict.PASS else (j.verdict.value, told)
    return _case(
        f"{procedure}.requirements", f"{j.quantity} {limit_text(j, j.required)}", failure, told
    )


def _step(procedure: str, step: StepFeasibility) -> Element:
    broken = [margin_in_words(m) for m in step.margins if not m.kept]
    told = "\n".join(margin_in_words(m) for m in step.margins)
    name = f"step {step.number} {step.kind}" + (f" {step.label}" if step.label else "")
    failure = ("infeasible", "; ".join(broken)) if not step.feasible else None
    return _case(f"{procedure}.steps", name, failure, told)


def _finding(procedure: str, number: int, found: Finding) -> Element:
    name = f"{number} {found.kind}" + (f" {found.step}" if found.step else "")
    return _case(f"{procedure}.findings", name, (found.kind, found.text), found.text)


def _compared(group: str, a: Achieved) -> Element:
    told = achieved_in_words(a)
    failure = ("contradicted", told) if a.agrees is False else None
    return _case(group, f"{method_text(a.method, a.window)} {a.quantity} {a.label}", failure, told)


def _clean(text: str) -> str:
    """Without the characters that XML cannot hold, however they are written."""
    return "".join(c if c in "\t\n\r" or _allowed(ord(c)) else "\ufffd" for c in text)


def _allowed(code: int) -> bool:
    return 0x20 <= code <= 0xD7FF or 0xE000 <= code <= 0xFFFD or code >= 0x10000
