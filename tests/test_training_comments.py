"""Comments of a teacher beside a recording: kept in the order of their times, and nothing else is taken for them."""

import pytest

from sonospline.training.comments import add_comment, comments_file, read_comments


def test_comments_are_kept_beside_the_recording_in_the_order_of_their_times(tmp_path):
    recording = tmp_path / "attempt.mcap"
    assert read_comments(recording) == ()
    add_comment(recording, 12.5, " Slower. ")
    found = add_comment(recording, 3.0, "Sweep first.")
    assert [(one.time_s, one.text) for one in found] == [(3.0, "Sweep first."), (12.5, "Slower.")]
    assert read_comments(recording) == found
    assert [path.name for path in tmp_path.iterdir()] == ["attempt.comments.json"]


@pytest.mark.parametrize("text", ["", "  ", "x" * 501])
def test_a_comment_that_says_nothing_or_too_much_is_refused(tmp_path, text):
    with pytest.raises(ValueError, match=r"^comment has \d+ letters; give 1 to 500$"):
        add_comment(tmp_path / "attempt.mcap", 1.0, text)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "content", [b"", b"no JSON", b"[]", b'{"comments": [{"time_s": "now"}]}', b'{"comments": 3}', b"\xff\xfe"]
)
def test_a_file_that_holds_something_else_is_refused_and_stays(tmp_path, content):
    path = comments_file(tmp_path / "attempt.mcap")
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"^attempt.comments.json holds no comments: .*; move it away$"):
        add_comment(tmp_path / "attempt.mcap", 1.0, "Sweep first.")
    assert path.read_bytes() == content
