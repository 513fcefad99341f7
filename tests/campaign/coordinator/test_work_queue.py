"""What is still to be computed, in order."""

import pytest

from campaign.coordinator.work_queue import Agenda
from campaign.worker.batch import Order


@pytest.fixture
def agenda(plan):
    """Return an agenda of batches of 10, 10 and 5, of which the second is there."""
    return Agenda(plan, [1], 25)


def handed_out(agenda):
    """Return all orders there are."""
    orders = []
    while (order := agenda.next()) is not None:
        orders.append(order)
    return orders


def test_missing_batches_in_order(agenda):
    """What is there is not asked for; what is put back comes first."""
    assert len(agenda) == 2
    assert handed_out(agenda) == [Order(0), Order(2)]
    agenda.again(Order(2, 2, apart=True))
    assert handed_out(agenda) == [Order(2, 2, apart=True)]
    assert not agenda


def test_samples_beyond_the_end_are_not_asked_for(plan):
    """A campaign that stopped at sample 10 needs its first batch, one that stopped at 11 two."""
    assert handed_out(Agenda(plan, [], 10)) == [Order(0)]
    assert handed_out(Agenda(plan, [], 11)) == [Order(0), Order(1)]


def test_complete_from_the_beginning_on(agenda):
    """Samples are held when no batch before them is missing."""
    assert not agenda.holds(1)
    agenda.finish(2)
    assert not agenda.holds(1)
    agenda.finish(0)
    assert agenda.holds(25)


def test_limit(agenda):
    """No batch from the limit on is handed out, until the limit moves."""
    agenda.limit = 2
    assert handed_out(agenda) == [Order(0)]
    agenda.limit = 3
    assert handed_out(agenda) == [Order(2)]
