"""What pages, actions and REST of the station work on."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from station.web.aqdef.settings import AqdefSettings
from station.web.bench.jogging import Jogging
from station.web.bench.watch import BenchWatch
from station.web.definition_trials import DefinitionTrials
from station.web.evaluations import Evaluations
from station.web.labels.settings import Labels
from station.web.mes.settings import MesSettings
from station.web.models import Models, ModelsFile
from station.web.people import audit
from station.web.people.database import StationDatabase
from station.web.recipe_text.dry_run import DryRuns
from station.web.running import Running
from station.web.settings import Settings


@dataclass(frozen=True)
class Station:
    """What actions work on."""

    data: Path
    database: StationDatabase
    models: Models
    running: Running
    run_options: tuple[str, ...] = ()
    """Further options of `lostmotion run`, as the server was started with them."""
    mes: MesSettings | None = None
    """The MES of the plant; None: none is asked or told."""
    settings: Settings = field(default_factory=Settings)
    labels: Labels | None = None
    """The labels of the plant; None: none is printed or asked for."""
    aqdef: AqdefSettings | None = None
    """The AQDEF files of the plant; None: none are written."""
    dry_runs: DryRuns = field(default_factory=DryRuns)
    evaluations: Evaluations = field(default_factory=Evaluations)
    """The process that makes reports and loops of stored runs."""
    models_file: ModelsFile | None = None
    """Where the table of models is read again when it has changed; None: it stays as it is."""
    trials: DefinitionTrials = field(default_factory=DefinitionTrials)
    """The definition that is on trial."""
    bench: BenchWatch = field(init=False)
    """What the bench shows, and the recovery from a fault."""
    jogging: Jogging = field(init=False)
    """The jog of the bench."""

    def __post_init__(self) -> None:
        """Look at the bench of the same data folder."""
        object.__setattr__(self, "jogging", Jogging(self.data, self._key_lost))
        object.__setattr__(self, "bench", BenchWatch(self.data, self.running, self.evaluations, self.jogging))

    def _key_lost(self, name: str) -> None:
        """Write that a key of the jog was let go without a word: its page was closed, or the connection is cut."""
        with self.database.writing() as connection:
            told = {"why": "lost", "before": {"held": True}, "after": {"held": False}}
            audit.write(connection, name, "release_jog", audit.DONE, told)

    def read_models(self) -> Models:
        """Return the table of models as its file is now; StationError where that was changed and is wrong."""
        found = None if self.models_file is None else self.models_file.changed()
        if found is not None:
            object.__setattr__(self, "models", found)
        return self.models

    def close(self) -> None:
        """Close what is open of it; a run that is on goes on."""
        self.running.close()
        self.jogging.close()
        self.dry_runs.close()
        self.evaluations.close()
        self.trials.close()
        self.database.close()
