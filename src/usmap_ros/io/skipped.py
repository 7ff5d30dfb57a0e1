"""Account of the messages of a recording that could not be used."""

import logging
from collections import Counter

from usmap_ros.errors import MalformedMessageError

logger = logging.getLogger(__name__)

#: So many skipped messages are named one by one; of the rest, only the total is told.
NAMED_MESSAGES = 3


class SkippedMessages:
    """Counts skipped messages by the field that was wrong, and names the first few."""

    def __init__(self) -> None:
        #: Number of messages by offending field.
        self.by_field: Counter[str] = Counter()

    @property
    def total(self) -> int:
        """How many messages were skipped."""
        return sum(self.by_field.values())

    def add(self, source: str, error: MalformedMessageError) -> None:
        """Note a message; `source` says which, for the log."""
        self.by_field[error.field] += 1
        if self.total <= NAMED_MESSAGES:
            logger.warning("%s: skipped, %s", source, error)

    def log_total(self, messages: int) -> None:
        """Say how many of `messages` were skipped and why, unless each one was named."""
        if self.total > NAMED_MESSAGES:
            causes = ", ".join(f"{field} ({n})" for field, n in self.by_field.most_common())
            logger.warning("skipped %d of %d messages, by field: %s", self.total, messages, causes)
