"""What `heronry status` says of code that a PE lacks."""

from heronry_tools.reports.troubles import code_troubles


def test_each_pe_that_lacks_code_has_a_line_with_what_to_do() -> None:
    (found,) = code_troubles({"code": {"nav": "nav, version 3: 7000 of 9000 bytes"}})
    assert found.says == "nav lacks code: nav, version 3: 7000 of 9000 bytes"
    assert "--code-dir" in (found.remedy or "")
    assert not list(code_troubles({"code": {}}))
