"""A case that fails keeps no other off: why it failed is told, the others go on, and the sitting ends by naming those that failed."""

from collections.abc import Callable, Iterable

from flows.endings import ending_of
from flows.exam_process import Unstarted


def attempted(case: str, work: Callable[[], object], say: Callable[[str], None]) -> bool:
    """Whether the work on a case came to its end; if not, why is told. Raises Unstarted, which would meet every other case too."""
    try:
        work()
    except Unstarted:
        raise
    except Exception as error:  # noqa: BLE001 - whatever it is, the other cases go on
        say(f"{case}: {ending_of(error)[1]}")
        return False
    return True


def name_failed(numbers: Iterable[int]) -> None:
    """Raises RuntimeError where there is any."""
    failed = ", ".join(map(str, numbers))
    if failed:
        raise RuntimeError(f"cases that failed, for the reasons told above, and are left for another time: {failed}")
