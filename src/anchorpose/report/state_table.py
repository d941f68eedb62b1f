"""How often each joint was seen, hidden (and by what) or lost, and how sure it is."""

from __future__ import annotations

from anchorpose.joints import JOINT_NAMES, JointState
from anchorpose.report.ledger import Form, Rows, Taking
from anchorpose.report.session import Session
from anchorpose.report.table import row, table
from anchorpose.report.words import COVERAGE, STATE_WORDS, named_part
from anchorpose.results.tables import JOINTS_FILE

_PERCENT = Form(times=100.0, share=True)


def state_table(session: Session) -> str:
    """HTML table: one row a joint, per cent of its frames in each state."""
    titles = ("joint", *(f"{words}, %" for words in STATE_WORDS.values()), "typical ±, mm", "source")
    body = "".join(row(named_part(name), _cells(session, name)) for name in JOINT_NAMES)
    return table("Share of the frames in each state, joint by joint", titles, f"<tbody>{body}</tbody>")


def _cells(session: Session, name: str) -> list[str]:
    ledger, rows = session.ledger, Rows(JOINTS_FILE, (("joint", name),))
    shares = [ledger.figure(rows, Taking(column="state", how="share", among=(str(s),)), _PERCENT) for s in JointState]
    typical = ledger.figure(rows, Taking(column="sigma_m", how="median"), Form(times=1000.0 * COVERAGE))
    return [*shares, typical, ledger.link(rows)]
