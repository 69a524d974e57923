"""Texts that break parsers, in place of sources, manifests and READMEs."""

from __future__ import annotations

HEX = "0x" + "f" * 20_000
#: Longer than the recursion limit, shorter than the parser's own.
DEEP = 1_500


def _grown(first: str, grown: str, use: str) -> str:
    """Give sixty constants, each made of the one before, and their use."""
    steps = "".join(f"a{n + 1} = {grown.replace('#', f'a{n}')}\n" for n in range(60))
    return f"a0 = {first}\n{steps}{use}\n"


SETUP = "setup(entry_points={'console_scripts': a60}, data_files=a60)\nself.create_publisher(String, a60, 10)"

TEXTS = {
    "a hundred thousand parentheses": "x = " + "(" * 100_000 + ")" * 100_000,
    "brackets that stay open": "[{(" * 50_000,
    "a long sum": "x = 'a'"
    + " + 'a'" * DEEP
    + "\nsetup(entry_points='a'"
    + " + 'a'" * DEEP
    + ")\n",
    "a longer sum": "x = 1" + " + 1" * 30_000,
    "a chain of attributes": "x = a" + ".b" * DEEP + ".create_publisher(1, 2, 3)\n",
    "a chain of calls": "x = a" + "()" * DEEP + "\n",
    "a chain of conditions": "def f():\n  if a:\n    pass\n" + "  elif b:\n    pass\n" * DEEP,
    "lambdas within each other": "x = " + "lambda: " * 500 + "1\n",
    "conditions within each other": "x = " + "1 if a else " * DEEP + "1\n",
    "classes within each other": "".join(" " * n + f"class A{n}:\n" for n in range(700)),
    "a number of a hundred thousand digits": "x = " + "9" * 100_000 + "\n",
    "a number that cannot be printed": (
        f"x = {HEX}\nself.create_publisher(String, {HEX}, {HEX})\nself.create_timer({HEX}, f)\n"
        f"self.declare_parameter('p', {HEX})\nQoSProfile(depth={HEX})\n"
        f"self.create_publisher(String, f'/t{{{HEX}}}', 10)\n"
        f"setup(entry_points={{'console_scripts': [{HEX}]}}, data_files=[({HEX}, [{HEX}])], name=str({HEX}))\n"
    ),
    "numbers that cannot be computed": (
        "self.create_timer(9**9**9**9, f)\nself.create_timer(1/0, f)\nself.create_timer(1<<10**9, f)\n"
        "self.create_publisher(String, 't' * 10**10, 10**10**10)\nsetup(data_files='a' * 10**10)\n"
    ),
    "text that doubles": _grown("'" + "x" * 1000 + "'", "# + #", SETUP),
    "text that doubles in f-strings": _grown("'x'", "f'{#}{#}'", SETUP),
    "text that doubles by format": _grown("'x'", "'{}{}'.format(#, #)", SETUP),
    "lists that double": _grown("['x']", "# + #", SETUP),
    "lists within each other": _grown("['x']", "[#, #]", SETUP),
    "values of other types": (
        "setup(entry_points={**{}, (1, 2): [3], 'console_scripts': {'a': 1}}, "
        "data_files=[('a', [1, None, b'x']), (glob(1), []), ([] % 1, []), ('{}'.format, [1]), ('a'.format(1), 2)])\n"
    ),
    "functions around much": "x = "
    + "lambda: " * 300
    + "["
    + "0, " * 3000
    + "]\nsetup(data_files=[])\n",
    "attributes of much": "f(["
    + "0, " * 3000
    + "])"
    + ".append" * 300
    + "\nsetup(data_files=[])\n",
    "methods of a choice beside much": (
        "setup(data_files=[], entry_points={'console_scripts': [('a=b:c' if 1 else ["
        + "0, " * 3000
        + "]).strip() for i in list('"
        + "i" * 1000
        + "')]})\n"
    ),
    "copies of a long text": "x = '"
    + "a" * 90_000
    + "'\nsetup(entry_points=[x.upper() for i in list('"
    + "i" * 900
    + "')])\n",
    "a list put in without end": (
        "set(a " + "x" * 900 + ")\nlist(APPEND b " + "${a} " * 500 + ")\nforeach(i ${b})\n"
        "message(" + "${b}y" * 1500 + ")\nendforeach()\ninstall(DIRECTORY d0 DESTINATION share/p)\n"
    ),
    "blanks without end": "[options.entry_points]\nx"
    + " " * 20_000
    + "y\nconsole_scripts =\n  a = b:c\n",
    "patterns without end": "setup(data_files=["
    + "('share/p', glob('"
    + "**/" * 11
    + "x'))," * 300
    + "])\n",
    "commands without end": "install(" * 30_000
    + "install(PROGRAMS " * 10_000
    + "ament_auto_package(" * 5_000,
    "more commands than files": "install(DIRECTORY a b c DESTINATION share/p)\n" * 5_000,
    "more scripts than anyone needs": "setup(entry_points='''[console_scripts]\n"
    + "a=b:c\n" * 5_000
    + "''')\n",
    "sections without end": "[a]\n" * 5_000
    + "[options.entry_points]\nconsole_scripts =\n"
    + "  a=b:c\n" * 5_000,
    "a zero byte": "import rclpy\nx = 1\0\n",
    "lone surrogates": "# \udfff\nx = '\ud800'\nself.create_publisher(String, '\ud800', 10)\n",
    "a line of a hundred thousand letters": "x" * 100_000,
    "a line of a hundred thousand words": "word " * 100_000,
    "lines without end": "x\n" * 10_000,
    "backslashes": "\\" * 100_001,
    "quotes": "'''\"" * 10_000,
    "fences": "```\n" * 30_000 + "`" * 100_000,
    "links and images": "[a](![" * 20_000,
    "emphasis and rules": "**_" * 30_000 + "\n---" * 10_000,
    "headings without words": "# h\n" * 8_000,
    "a letter with a hundred thousand accents": "a" + "\u0301" * 100_000,
    "elements within each other": "<a>" * 50_000 + "</a>" * 50_000,
    "a manifest of depth": "<package><name>p</name>"
    + "<a>" * 50_000
    + "</a>" * 50_000
    + "</package>",
    "entities": '<!DOCTYPE p [<!ENTITY a "aa"><!ENTITY b "&a;&a;">]><package><name>&b;</name></package>',
    "another encoding": '<?xml version="1.0" encoding="utf-16"?><package><name>p</name></package>',
    "a package's name without end": "<package><name>" + "a" * 100_000 + "</name></package>",
    "a package's name that leads away": "<package><name>../../p</name></package>",
}
