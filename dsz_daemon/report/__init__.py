"""Pictures of a run: one self-contained HTML page.

Reading order: `page` (what stands where), `results` (the numbers), `verdict` (the sentence),
`tables`, `counts`, `channel_figures` and `drive_figures` (what is shown), `panels` (how pictures are
stacked), `thinning` (how many points), `markup` and `display` (how things are written).
"""

from dsz_daemon.report.page import write_report

__all__ = ["write_report"]
