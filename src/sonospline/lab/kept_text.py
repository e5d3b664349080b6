"""Codes, names and comments as the lab keeps them, or in a line why it does not."""

from __future__ import annotations

import re

from .. import _validate
from .._shown import shown
from .schema import LONGEST_CODE, LONGEST_COMMENT, LONGEST_NAME

_CODE = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")


def check_code(code: str) -> str:
    """Return a participant's code, or raise ValueError: names are not kept."""
    if not (isinstance(code, str) and len(code) <= LONGEST_CODE and _CODE.fullmatch(code)
            and any(sign.isdigit() for sign in code)):  # fmt: skip
        raise ValueError(
            f"code = {shown(code)} is no code; give at most {LONGEST_CODE} letters, digits, - and _, with a digit, "
            "e.g. K-17: names are not kept"
        )
    return code


def check_comment(text: str) -> str:
    """Return a comment without blanks around it, or raise ValueError."""
    text = _kept_text("comment", text)
    if not 0 < len(text) <= LONGEST_COMMENT:
        raise ValueError(f"comment has {len(text)} letters; give 1 to {LONGEST_COMMENT}")
    return text


def _kept_text(what: str, text: str) -> str:
    text = _validate.text(what, text).strip()
    if "\0" in text:
        raise ValueError(f"{what} = {shown(text)} holds a zero character, which no database keeps; leave it out")
    return text


def check_name(what: str, name: str) -> str:
    """Return a name without blanks around it, or raise ValueError."""
    name = _kept_text(what, name)
    if not 0 < len(name) <= LONGEST_NAME:
        raise ValueError(f"{what} = {shown(name)} has {len(name)} letters; give 1 to {LONGEST_NAME}")
    return name
