"""A check of the counter's reset."""

from dataclasses import dataclass

from grader.own_checks import Context, EarlierCheckId, Finding, Part, Topic, Window, of_parts


@dataclass
class Parameters:
    topic: Topic
    kept: Window
    kept_first: int
    again: Window
    again_first: int
    #: Check of the answer to false; a node that ends with that call sends no more sums.
    refusal: EarlierCheckId


def resets(context: Context, p: Parameters) -> Finding:
    """The first sum after each of the two calls: one goes on from before, one begins at zero."""
    kept = _first(context, p.topic, p.kept, p.kept_first, "a request with false")
    if not len(context.messages(p.topic, window=p.kept)):
        kept = context.charge_part(kept, None, [p.refusal])
    again = _first(context, p.topic, p.again, p.again_first, "a request with true")
    parts = [again, kept]
    return of_parts(f"{p.kept_first} after false, {p.again_first} after true", parts)


def _first(context: Context, topic: str, window: str, wanted: int, after: str) -> Part:
    found = [value for value in context.messages(topic, window=window).field("data") if value is not None]
    if not found:
        return Part(0.0, f"nothing after {after}", f"No sum came after {after}.")
    text = f"{found[0]} after {after}"
    if found[0] == wanted:
        return Part(1.0, text)
    return Part(0.0, text, f"The first sum after {after} is {found[0]}, not {wanted}.")
