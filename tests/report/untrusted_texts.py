"""Texts as hostile students write them, for the tests of every sink."""

from __future__ import annotations

from hypothesis import strategies as st

#: Texts that one parser or another obeys.
FRAGMENTS = (
    "\x1b[2J", "\x1b]0;owned\x07", "\x1b]8;;http://evil.example\x1b\\", "\x9b31m", "\x00", "\x08", "\r", "\n", "\r\n",
    "\t", "\u202e", "\u2066", "\u200b", "\ufeff", "\u2028", "\u2029", "\x85", "\ud800", "\udcff", "\udfff", "\uffff",
    "\ufffe", "]]>", "<![CDATA[", "<!--", "-->", "<script>alert(1)</script>", "<b>", "&amp;", "&#64;", "&", "<?xml?>",
    "<!DOCTYPE x>", "::error::", "::error file=a.py,line=1::pwned", "::stop-commands::x", "::add-mask::a",
    "::set-output name=a::b", "##[error]", "##[group]x", "##vso[task.setvariable variable=a]b", "##teamcity[x]",
    "%0A::error::x", "%250A", ":::", "`", "``", "```", "~~~", "$x$", "$`x`$", "|", "\\|", "\\", "*", "**b**", "_",
    "__b__", "[l](http://evil.example)", "![i](x)", "[^1]", "[x]", "- [ ] ", "> ", "> [!NOTE]", "# ", "1. ", "1) ",
    "---", "===", ":--", "|-|", "    ", "+ ", "* ", "<http://a.b>", "http://evil.example/", "HTTPS://e.x",
    "ftp://e.x/y", "www.evil.example", "WWW.E.X", "mailto:a@b.c", "a@evil.example", "a@b.c", "@alice", "@org/team",
    "#12", "org/repo#12", "GH-12", "ABC-123", "deadbeef", "0123456789abcdef0123456789abcdef01234567", ":tada:",
    ":+1:", "a_b", "a.py", "a/b/c.py:12", "/joint_commands", "=cmd|' /C calc'!A0", "+1", "-1", "@SUM(A1)",
    "[[ATTACHMENT|/etc/passwd]]", "z\u0301\u0301\u0301\u0301", "\U0001f600", "日本語", "ü", "word", " ", "'", '"', ",",
    ".", ":", "::", "(", ")", "!", "?", "e\u200d",
)  # fmt: skip

hostile = st.lists(
    st.one_of(
        st.sampled_from(FRAGMENTS),
        st.text(st.characters(categories=None), max_size=8),
        st.text("`|$:@.#a1_\\", max_size=8),
    ),
    max_size=12,
).map("".join)
#: A text too long for every sink.
MEGABYTE = "".join(FRAGMENTS) * 2000
