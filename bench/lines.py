"""Lines of Python by package, the installed ones and the rest: ``make lines``."""

from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def main() -> None:
    files, lines = Counter[str](), Counter[str]()
    for top in ("rft_ros", "studies", "test", "bench"):
        for file in (ROOT / top).rglob("*.py"):
            parts = file.relative_to(ROOT).parts
            inside = f"  {parts[1]}/" if len(parts) > 2 else "  modules"
            count = len(file.read_text(encoding="utf-8").splitlines())
            for name in (top, inside) if top == "rft_ros" else (top,):
                files[name] += 1
                lines[name] += count
    for name, count in lines.most_common():
        print(f"{name:16} {files[name]:4} files {count:7,} lines")


if __name__ == "__main__":
    main()
