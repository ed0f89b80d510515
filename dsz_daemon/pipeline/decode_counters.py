"""All that a decoder remembers and counts: plain values, to be copied, saved, shown and handed back."""

from __future__ import annotations

from dataclasses import dataclass, field, replace


@dataclass(slots=True)
class RoleCounts:
    """What became of one role's frames; each frame used for the role is in exactly one count.

    `short`: too few bytes for the role's signals. `not_present`: the multiplexer carried other
    signals (no fault). `flagged`: its valid signal did not vouch. `not_a_number`: NaN or infinite.
    `out_of_range`: outside the bounds of its source (which are inclusive).
    """

    samples: int = 0
    short: int = 0
    not_present: int = 0
    flagged: int = 0
    not_a_number: int = 0
    out_of_range: int = 0

    @property
    def rejected(self) -> int:
        """Values that came but were not used."""
        return self.short + self.flagged + self.not_a_number + self.out_of_range

    @property
    def refuses_many(self) -> bool:
        """Whether so many were refused that it is worth a word: more than one in a hundred of those used."""
        return self.rejected > 0.01 * self.samples

    def words(self) -> str:
        """How many values were refused, and why."""
        return (
            f"{self.rejected} of {self.rejected + self.samples} values refused (short {self.short}, "
            f"flagged {self.flagged}, NaN {self.not_a_number}, out of range {self.out_of_range})"
        )


@dataclass(slots=True)
class Sender:
    """What must be known of one message on one channel to judge its next frame.

    `due_ns`: the rate bound's only memory (see `rate_bound`). `counter` and `counter_ns`: the last alive
    counter of an intact frame and that frame's stamp; `unread`: frames that came since, but were babbling
    or had a wrong checksum; `out_of_step`: the last counter was out of sequence, and the next one must fit
    before it counts.
    """

    due_ns: int | None = None
    counter: int | None = None
    counter_ns: int = 0
    unread: int = 0
    out_of_step: bool = False


@dataclass(slots=True)
class MessageCounts:
    """One wanted message; each of its frames is in exactly one of `frames` (used) and the refused ones.

    Refused as a whole are `babbling` (beyond the rate bound), `wrong_checksum` (or too short to have
    one), `repeated` (the alive counter stood still: a stuck sender or a frame sent again) and
    `wrong_sequence` (it jumped further than a loss explains, or had just done so). `lost` counts frames
    that never came, by the alive counter. `wrong_length`: shorter or longer than the DBC says, used or
    not. `last_t_ns`: stamp of the last one used. `channel` is the first channel it came from: sources
    that name no channel are bound to it. `senders` is what is remembered by channel.

    Not among them, and not used: `other_width`, frames of the id's number with 11 bits where the DBC has
    29 or the other way round, and `elsewhere`, on channels that none of its signals names.
    """

    frames: int = 0
    wrong_length: int = 0
    last_t_ns: int | None = None
    channel: str | None = None
    babbling: int = 0
    wrong_checksum: int = 0
    repeated: int = 0
    wrong_sequence: int = 0
    lost: int = 0
    other_width: int = 0
    elsewhere: int = 0
    elsewhere_on: str | None = None
    senders: dict[str, Sender] = field(default_factory=dict)

    @property
    def refused(self) -> int:
        """Frames that were not used as a whole."""
        return self.babbling + self.wrong_checksum + self.repeated + self.wrong_sequence

    def near_misses(self, is_extended: bool) -> list[str]:
        """What came instead of its frames, where that may be a slip of DBC or configuration."""
        words = []
        if self.other_width:
            wide, narrow = "extended (29 bit)", "standard (11 bit)"
            came, said = (narrow, wide) if is_extended else (wide, narrow)
            words.append(f"{self.other_width} frames have its id as {came}, the DBC as {said}")
        if self.elsewhere:
            words.append(f"{self.elsewhere} frames of it came on {self.elsewhere_on}, where it is not looked for")
        return words

    def copy(self) -> MessageCounts:
        """Return an equal value that shares nothing with this one."""
        return replace(self, senders={channel: replace(sender) for channel, sender in self.senders.items()})


@dataclass(slots=True)
class DecodeCounters:
    """All that a decoder remembers; plain values, so that it can be saved and handed back.

    `frames` counts every frame; `unwanted` those of ids or channels that nothing is mapped to,
    `own` those of ids that this daemon publishes, `ambiguous` those of a wanted id on a second
    channel although their source names none.
    """

    frames: int = 0
    unwanted: int = 0
    own: int = 0
    remote: int = 0
    error_frames: int = 0
    ambiguous: int = 0
    roles: dict[str, RoleCounts] = field(default_factory=dict)
    messages: dict[str, MessageCounts] = field(default_factory=dict)

    @property
    def samples(self) -> int:
        """Samples of all roles."""
        return sum(counts.samples for counts in self.roles.values())

    @property
    def rejected(self) -> int:
        """What came but was not used: values of all roles, and frames that were refused as a whole (one each)."""
        values = sum(counts.rejected for counts in self.roles.values())
        return values + sum(counts.refused for counts in self.messages.values())

    def copy(self) -> DecodeCounters:
        """Return an equal value that shares nothing with this one."""
        return replace(
            self,
            roles={role: replace(counts) for role, counts in self.roles.items()},
            messages={name: counts.copy() for name, counts in self.messages.items()},
        )
