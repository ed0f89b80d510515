"""What one configuration sets up for a live run: from decoder to summary. A reload replaces all of it at once."""

from __future__ import annotations

from dataclasses import dataclass

from dsz_daemon.core.state import EstimatorState
from dsz_daemon.pipeline.cycles import CycleWatch
from dsz_daemon.pipeline.decode import Decoder
from dsz_daemon.pipeline.encode import Encoder
from dsz_daemon.pipeline.loop import Loop
from dsz_daemon.runs.memory import recalled, remembered
from dsz_daemon.runs.setup import Setup
from dsz_daemon.runs.summary import RunSummary


@dataclass
class Chain:
    """The parts in the order in which a frame passes them."""

    setup: Setup
    encoder: Encoder
    decoder: Decoder
    loop: Loop
    summary: RunSummary
    cycles: CycleWatch

    @classmethod
    def begun(cls, setup: Setup, estimator: EstimatorState | None = None) -> Chain:
        """From nothing, or from what was learnt before."""
        encoder = setup.encoder()
        return cls._of(setup, encoder, setup.decoder(encoder), estimator)

    @classmethod
    def _of(cls, setup: Setup, encoder: Encoder, decoder: Decoder, estimator: EstimatorState | None) -> Chain:
        summary = RunSummary(setup, setup.plausibility())
        return cls(setup, encoder, decoder, setup.loop(decoder, estimator), summary, CycleWatch(decoder.wanted_ids()))

    @property
    def period_ns(self) -> int:
        """Of the ticks."""
        return self.loop.settings.period_ns

    @property
    def guard_ns(self) -> int:
        """How long a tick waits for frames on their way."""
        return round(self.setup.settings.loop.guard_s * 1e9)

    def succeeded_by(self, setup: Setup, now_ns: int) -> Chain:
        """The chain of another configuration: counters go on, offsets of channels that are still the same too."""
        body = remembered(self.setup, self.loop.memory.estimator, now_ns, None)
        encoder = setup.encoder(self.encoder.state)
        decoder = setup.decoder(encoder, self.decoder.counters)
        chain = self._of(setup, encoder, decoder, recalled(setup, body, now_ns).estimator)
        chain.loop.memory.counters = self.loop.memory.counters
        return chain
