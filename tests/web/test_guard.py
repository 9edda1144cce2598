"""Who is let in: by Host, by Origin, by token."""

import socket

import pytest

from heronry_tools.console.errors import UserError
from heronry_tools.web.guard import HEADERS, Access, Asked, refusal
from heronry_tools.web.serving import access, listening

TOKEN = "t0ken"
LOCAL = Access("127.0.0.1", 8321, TOKEN)
OPERATED = Access("127.0.0.1", 8321, TOKEN, operates=True)
REMOTE = Access("192.0.2.7", 8321, TOKEN)
WITH_TOKEN = {"authorization": f"Bearer {TOKEN}"}
JSON = {"content-type": "application/json"}


def code(access: Access, method: str, path: str, query: str = "", **headers: str) -> int | None:
    given = {"host": f"{access.address}:8321"} | {name.replace("_", "-"): value for name, value in headers.items()}
    refused = refusal(access, Asked(method, path, given, query))
    return refused and refused.code


def posted(access: Access, path: str, **headers: str) -> int | None:
    own = {"origin": f"http://{access.address}:8321", "content_type": "application/json"}
    return code(access, "POST", path, **{**own, **headers})


@pytest.mark.parametrize("host", ["127.0.0.1:8321", "localhost:8321", "[::1]:8321"])
def test_a_loopback_address_reads_without_a_token(host):
    assert code(LOCAL, "GET", "/api/snapshot", host=host) is None


@pytest.mark.parametrize("host", ["evil.example:8321", "127.0.0.1", "127.0.0.1:80", "", ":8321", "192.0.2.7:8321"])
def test_a_name_that_was_bound_to_this_address_later_is_refused(host):
    assert code(LOCAL, "GET", "/api/snapshot", host=host) == 403
    assert code(LOCAL, "GET", "/", host=host) == 403


def test_another_address_is_one_of_this_server_where_it_listens_there():
    assert code(REMOTE, "GET", "/", host="192.0.2.7:8321") is None
    assert code(REMOTE, "GET", "/", host="[2001:db8::7]:8321") is None  # it may listen on all
    assert code(REMOTE, "GET", "/", host="evil.example:8321") == 403


@pytest.mark.parametrize("origin", ["http://evil.example", "http://127.0.0.1:9999", "https://127.0.0.1:8321", "null"])
def test_a_page_of_another_origin_is_refused(origin):
    assert code(LOCAL, "GET", "/api/snapshot", origin=origin) == 403
    assert posted(OPERATED, "/api/order", origin=origin, **WITH_TOKEN) == 403


def test_an_order_needs_operate_and_the_token():
    assert posted(LOCAL, "/api/order", **WITH_TOKEN) == 403
    assert posted(OPERATED, "/api/order") == 401
    assert posted(OPERATED, "/api/order", authorization="Bearer other") == 401
    assert posted(OPERATED, "/api/order", **WITH_TOKEN) is None


def test_what_asks_or_orders_names_its_origin_and_is_json():
    own = {"origin": "http://127.0.0.1:8321"}
    assert code(OPERATED, "POST", "/api/order", **WITH_TOKEN) == 403
    assert code(OPERATED, "POST", "/api/order", **WITH_TOKEN, **own) == 415
    assert posted(OPERATED, "/api/order", content_type="text/plain", **WITH_TOKEN) == 415
    assert code(LOCAL, "POST", "/api/ask") == 403


def test_reading_from_elsewhere_needs_the_token():
    assert code(REMOTE, "GET", "/") is None  # the page itself says nothing of the system
    assert code(REMOTE, "GET", "/api/snapshot") == 401
    assert code(REMOTE, "GET", "/api/snapshot", **WITH_TOKEN) is None
    assert code(REMOTE, "GET", "/api/events.jsonl", query=f"token={TOKEN}") is None
    assert code(REMOTE, "GET", "/api/events.jsonl", query="token=") == 401


def test_only_reading_and_asking_are_understood():
    assert code(LOCAL, "DELETE", "/api/snapshot") == 405


def test_the_address_has_the_token_where_no_browser_sends_it():
    assert OPERATED.url(with_token=True) == f"http://127.0.0.1:8321/#token={TOKEN}"
    assert Access("::1", 80, TOKEN).url(with_token=False) == "http://[::1]:80/"


def test_a_server_on_all_addresses_is_opened_by_the_name_of_its_computer():
    everywhere = Access("0.0.0.0", 8321, TOKEN)
    assert everywhere.url(with_token=True) == f"http://{socket.gethostname()}:8321/#token={TOKEN}"
    assert code(everywhere, "GET", "/", host=f"{socket.gethostname()}:8321") is None
    assert code(everywhere, "GET", "/api/snapshot", host="192.0.2.7:8321") == 401


def test_an_address_that_is_none_of_this_computer_is_a_sentence():
    for address, port in (("192.0.2.7", None), ("no such name", 0)):
        with pytest.raises(UserError, match="name another address or port"):
            listening(address, port)


def test_without_a_port_another_one_is_taken_where_the_usual_one_is_taken():
    with listening("localhost", None) as first, listening("127.0.0.1", None) as second:
        assert access(first, operates=False).is_local
        assert first.getsockname() != second.getsockname()


def test_nothing_is_loaded_from_elsewhere():
    policy = HEADERS["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "http" not in policy
