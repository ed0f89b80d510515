"""Pictures of a run, and of a simulated drive: each one self-contained HTML page.

Reading order: `page` (what stands where), `results` (the numbers), `verdict` (the sentence),
`tables`, `counts`, `channel_figures`, `drive_figures`, `paper_figures` and `rms_bars` (what is shown),
`panels` (how pictures are stacked), `thinning` (how many points), `offline_page`, `markup` and `display`
(how things are written). A simulated drive's page is `truth_page`, with `truth_figures` and `truth_table`.
"""

from dsz_daemon.report.page import write_report

__all__ = ["write_report"]
