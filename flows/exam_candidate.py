"""The command line as an examined process sees it: folders that end in `.truth`, and the generator of the exam, are closed to it.

Where what would answer cannot be imported, nobody was asked: the exit code is `UNSTARTED`, and that is no wrong answer.
"""

import sys
import traceback
from importlib import import_module

CLOSED = (".truth", "tasks/exam/generator", "exam-scoreboard")
OPENING = {"open", "os.listdir", "os.scandir", "os.chdir", "os.link", "os.symlink", "os.rename", "shutil.copyfile"}
STARTING = {"subprocess.Popen", "os.system", "os.exec", "os.posix_spawn"}
ANSWERING = {"gap": "flows.gap", "exam": "flows.exam_rival"}  # what a command imports
UNSTARTED = 70  # sysexits.h: internal software error


def closed(event: str, arguments: tuple) -> None:
    """Audit hook. Raises PermissionError for what an examined process may not do."""
    if event == "import" and arguments[0].startswith("tasks.exam.generator"):
        raise PermissionError(f"{arguments[0]}: a diagnosis may not import the generator of its questions")
    texts = [str(a, "utf-8", "replace") if isinstance(a, bytes) else str(a) for a in arguments[:2]]
    if event in OPENING and any(name in text for text in texts for name in CLOSED):
        raise PermissionError(f"{texts[0]}: a diagnosis may not open the truth it is judged by")
    if event in STARTING and any(name in text for text in texts for name in CLOSED):
        raise PermissionError(f"{texts[0]}: a diagnosis may not send others for the truth")


if __name__ in ("__main__", "__mp_main__"):  # the second: processes that multiprocessing starts anew
    sys.addaudithook(closed)

if __name__ == "__main__":
    try:
        import_module(ANSWERING[sys.argv[1]])
    except ImportError:
        traceback.print_exc()
        sys.exit(UNSTARTED)

    from flows.cli import main

    main()
