"""``python -m clearcap`` is the command ``clearcap``."""

from campaign.__main__ import main

if __name__ == "__main__":
    main()
