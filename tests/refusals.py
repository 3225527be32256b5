"""What a public entry answers to nonsense."""

import pytest

from swingup.common.errors import SwingupError


def refusal(call, *given, **options):
    """The message of the ``SwingupError`` in which a call must end: one printable line."""
    with pytest.raises(SwingupError) as error:
        call(*given, **options)
    text = str(error.value)
    assert text.isprintable()
    return text
