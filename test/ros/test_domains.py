"""Tests share no domain: nodes of another one would be taken for their own."""

from typing import Any

from test.ros.conftest import Live, is_empty


def test_a_domain_that_a_node_listens_in_is_not_given_to_a_test(live: Any, domain: int) -> None:
    assert not is_empty(domain)


def test_a_domain_is_free_again_when_its_nodes_have_ended(domain: int) -> None:
    assert is_empty(domain)
    place = Live(domain)
    place.close()
    del place
    assert is_empty(domain)
