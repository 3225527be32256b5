import os
import stat

import pytest

from swingup.common.errors import SwingupError
from swingup.common.files import write_atomically


def test_a_link_keeps_pointing_and_a_mode_stays(tmp_path):
    target, link = tmp_path / "target", tmp_path / "link"
    target.write_bytes(b"old")
    target.chmod(0o600)
    link.symlink_to(target)
    write_atomically(link, b"new")
    assert link.is_symlink()
    assert target.read_bytes() == b"new"
    assert stat.S_IMODE(target.stat().st_mode) == 0o600


def test_a_device_is_written_to_and_not_replaced():
    write_atomically("/dev/null", b"gone")
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)


def test_a_folder_that_is_missing(tmp_path):
    with pytest.raises(SwingupError, match="cannot write"):
        write_atomically(tmp_path / "missing" / "file", b"")
    assert list(tmp_path.iterdir()) == []
