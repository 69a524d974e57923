"""Checks of this lab: the unchanged header of a filtered scan, and the state of an obstacle."""

from dataclasses import dataclass

import numpy as np

from grader.own_checks import Context, Finding, Topic, Window, failed, graded

API_VERSION = 1
KEPT = ("header.frame_id", "angle_min", "angle_increment", "range_min", "range_max")


def stamps(messages):
    return list(zip(messages.field("header.stamp.sec"), messages.field("header.stamp.nanosec")))


@dataclass
class Kept:
    topic: Topic
    source: Topic
    window: Window


def keeps_header(context: Context, p: Kept) -> Finding:
    """Each message has the stamp of a scan, and its frame and angles."""
    given, got = context.messages(p.source), context.messages(p.topic, p.window)
    where = [context.location(p.topic, p.window)]
    expected = "stamp, frame and angles of the scan"
    if not len(got.sent_s):
        return failed(expected, "no messages", "Nothing was published while the node should be active.", where=where)
    known = dict(zip(stamps(given), zip(*(given.field(path) for path in KEPT))))
    mine = list(zip(stamps(got), zip(*(got.field(path) for path in KEPT))))
    wrong_stamps = sum(stamp not in known for stamp, _ in mine)
    if wrong_stamps > 0.1 * len(mine):
        return failed(
            expected,
            f"{wrong_stamps} of {len(mine)} stamps are of no scan",
            "The messages do not have the stamps of the scans from which they are made.",
            hint="Copy the header: out.header = scan.header.",
            where=where,
        )
    changed = [
        path
        for i, path in enumerate(KEPT)
        if any(values[i] != known[stamp][i] for stamp, values in mine if stamp in known)
    ]
    return graded(
        1 - len(changed) / len(KEPT) if changed else 1.0,
        expected,
        f"changed: {', '.join(changed) or 'nothing'}",
        f"Of the scan, {', '.join(changed)} did not stay.",
        hint="Copy all of the scan, then replace its ranges.",
        where=where,
    )


@dataclass
class States:
    topic: Topic
    source: Topic
    window: Window
    blocked_m: float = 0.5
    near_m: float = 1.5


def state_fits(context: Context, p: States) -> Finding:
    """The state belongs to the scan with the same stamp."""
    given, got = context.messages(p.source), context.messages(p.topic, p.window)
    nearest = {
        stamp: min(row) for stamp, row in zip(stamps(given), given.numbers("ranges")) if row is not None and len(row)
    }
    right = {"BLOCKED": 0, "NEAR": 0, "FREE": 0}
    seen = dict(right)
    for stamp, state in zip(stamps(got), got.field("state")):
        distance = nearest.get(stamp)
        if distance is None or min(abs(distance - p.blocked_m), abs(distance - p.near_m)) < 0.001:
            continue
        true = "BLOCKED" if distance < p.blocked_m else "NEAR" if distance < p.near_m else "FREE"
        seen[true] += 1
        right[true] += str(state).strip().upper() == true
    expected = f"BLOCKED below {p.blocked_m:g} m, NEAR below {p.near_m:g} m, else FREE"
    if not all(seen.values()):
        return failed(expected, f"states that could be compared: {seen}", "Not each state could be compared.")
    shares = {state: right[state] / seen[state] for state in seen}
    measured = ", ".join(f"{state} {right[state]} of {seen[state]}" for state in seen)
    worst = min(shares, key=shares.get)
    return graded(
        sum(shares.values()) / 3 if min(shares.values()) < 0.97 else 1.0,
        expected,
        measured + " right",
        f"Where the nearest ray makes it {worst}, the state is often another.",
        where=[context.location(p.topic, p.window)],
        levels=4,
    )


def median(row):
    out = row.copy()
    if len(row) > 2:
        out[1:-1] = np.median(np.stack([row[:-2], row[1:-1], row[2:]]), axis=0)
    return out


@dataclass
class Filtered:
    topic: Topic
    source: Topic
    window: Window
    least_m: float = 0.125
    most_m: float = 8.0
    tolerance_m: float = 0.001


def filters(context: Context, p: Filtered) -> Finding:
    """Each filtered scan is the scan of its stamp, clamped, and each ray the median of three."""
    given, got = context.messages(p.source), context.messages(p.topic, p.window)
    scans = dict(zip(stamps(given), given.numbers("ranges")))
    meanings = {
        "clamped, but the outliers are still there": lambda row: np.clip(row, p.least_m, p.most_m),
        "without outliers, but not clamped": median,
        "as they came": lambda row: row,
    }
    pairs = [(scans[stamp], row) for stamp, row in zip(stamps(got), got.numbers("ranges")) if stamp in scans]
    expected = "all rays clamped, and the median of three"
    where = [context.location(p.topic, p.window)]
    if not pairs:
        return failed(expected, "no message with a scan's stamp", "No message could be compared.", where=where)

    def right(wanted):
        return sum(
            row is not None
            and scan is not None
            and len(row) == len(scan)
            and bool(np.allclose(row, wanted(scan), atol=p.tolerance_m, rtol=0))
            for scan, row in pairs
        ) / len(pairs)

    share = right(lambda row: median(np.clip(row, p.least_m, p.most_m)))
    measured = f"{100 * share:.0f}% of {len(pairs)} messages are right"
    if share >= 0.97:
        return graded(1.0, expected, measured, "", where=where)
    for meaning, wanted in meanings.items():
        if right(wanted) >= 0.9:
            credit = 0.0 if meaning == "as they came" else 0.5
            return graded(credit, expected, measured, f"The ranges are {meaning}.", where=where)
    return graded(share, expected, measured, "Some ranges are not as told.", where=where, levels=4)
