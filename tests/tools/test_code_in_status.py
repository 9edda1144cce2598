"""What `heronry status` says of code that a PE lacks."""

from heronry_tools.reports.troubles import code_troubles, element_troubles
from manager.one_manager import OneManager

COMING = {"nav": "nav, version 3: 7000 of 9000 bytes"}
LACK = {"element": "module:pilot@nav", "by": "nav", "code": "MODULE_MISSING", "detail": 0, "for_ns": 0}


def test_each_pe_that_lacks_code_has_a_line_with_what_to_do() -> None:
    (found,) = code_troubles({"code": COMING, "latched": []})
    assert found.says == "nav lacks code: nav, version 3: 7000 of 9000 bytes"
    assert "--code-dir" in (found.remedy or "")
    assert not list(code_troubles({"code": {}, "latched": []}))
    assert not list(code_troubles({"latched": []}))  # of an older manager


def test_a_lack_has_one_line_whose_remedy_depends_on_whether_its_code_is_coming() -> None:
    status = {**OneManager().core.status(), "latched": [LACK]}
    (found,) = [*code_troubles(status), *element_troubles(status)]
    assert (found.remedy or "").startswith("install the code of module:pilot@nav on nav")
    (found,) = [*code_troubles(status | {"code": COMING}), *element_troubles(status | {"code": COMING})]
    assert found.says.endswith("its code cannot be run there; nav, version 3: 7000 of 9000 bytes")
    assert (found.remedy or "").startswith("wait for it")
