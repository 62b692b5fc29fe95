"""Every message tells the value received and the remedy."""

import ast
import re
from pathlib import Path

import preisach_jax

PACKAGE = Path(preisach_jax.__file__).parent


REMEDY = re.compile(
    r"""(?ix)
    \b(add|ask|begin|call|change|check|choose|compare|complete|compute|convert|copy|correct|cut|
       declare|define|delete|derive|did\ you\ mean|drop|enter|export|fill|finish|fit|give|have|hold|
       identify|install|keep|leave|let|limit|load|lower|make|measure|mend|move|name|narrow|open|
       pass|put|read|record|remove|rename|repeat|replace|run|save|say|see|set|simulate|sort|split|
       start|store|take|train|try|unpack|update|use|wait|widen|write)\b
    | \bmust\b | \bexpected\b
    | \{(remedy|refusal|hint|_AGAIN|_REMEDY|error|said.*|rest|_none_found.*)\}
    """
)
NOTHING_GIVEN = {  # what is missing is no value
    "there is no wanted course yet; drop its file above",
    "models is empty: give at least one model",
    "records: give input and output of each, as (record.input, record.output)",
    "response has lines that are zero or not finite: leave them out",
}
NOT_THERE = re.compile(r"is not installed|there is no C compiler|JAX computes in float32")


def text_of(node):
    """A message as far as the source shows it, with what is put into it in braces."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(text_of(part) for part in node.values)
    if isinstance(node, ast.FormattedValue):
        return f"{{{ast.unparse(node.value)}}}"
    if isinstance(node, ast.BinOp):
        return text_of(node.left) + text_of(node.right)
    return f"{{{ast.unparse(node)}}}"


TOLD = {"InputError", "QuestionError", "EffectError", "NotFiniteError"}


def lacks(text):
    """Whether a message names no value that was received, or no remedy."""
    has_value = "{" in text or text in NOTHING_GIVEN or NOT_THERE.search(text)
    return not (has_value and REMEDY.search(text))


def test_every_message_names_what_was_received_and_the_remedy():
    made = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and ast.unparse(node.func) in TOLD:
                place = f"{path.relative_to(PACKAGE)}:{node.lineno}"
                made[place] = text_of(node.args[0]) if node.args else ""
    assert len(made) > 300
    assert not {place: text for place, text in made.items() if lacks(text)}
    assert lacks("levels is {levels}")
    assert lacks("give another number")
