"""Two processes do not agree on a message."""

from __future__ import annotations

from common.errors.base import LegatoError


class ContractError(LegatoError):
    """Two processes do not agree on a message."""

    code = "E-CONTRACT"
    http_status = 502


class SchemaMismatch(ContractError):
    """A message whose schema or version is not the topic's."""

    code = "E-SCHEMA"

    def __init__(self, topic: str, expected: str, got: str) -> None:
        self.topic = topic
        self.expected_schema = expected
        self.got_schema = got
        super().__init__(
            f"{topic}: message of schema {got or '(none)'}",
            expected=f"expected {expected}",
            action="run the same version of LEGATO in every process",
        )


class MalformedMessage(ContractError):
    """Bytes of the right schema that do not decode or validate."""

    code = "E-MALFORMED"

    def __init__(self, topic: str, schema: str, problem: str) -> None:
        self.topic = topic
        self.schema = schema
        self.problem = problem
        super().__init__(
            f"{topic}: {problem}",
            expected=f"expected a valid {schema}",
            action="look at the sender; the message was dropped",
        )


class ForeignMessage(ContractError):
    """A message that speaks of another cell or node than the one on whose key it came.

    Rights go by keys: believed, it would carry them further.
    """

    code = "E-FOREIGN"

    def __init__(self, topic: str, owner: str, spoken_of: str) -> None:
        self.topic = topic
        self.owner = owner
        self.spoken_of = spoken_of
        super().__init__(
            f"{topic} of {owner} speaks of {spoken_of or 'nobody'}",
            expected=f"expected it to speak of {owner}",
            action="look at the sender; the message was dropped",
        )


class WrongShape(ContractError):
    """An array that is too short or too long for the robot."""

    code = "E-SHAPE"

    def __init__(self, what: str, expected: int, got: int) -> None:
        self.what = what
        self.expected_length = expected
        self.got_length = got
        super().__init__(
            f"{what} has {got} values",
            expected=f"expected {expected}",
            action="check that both sides use the same robot",
        )
