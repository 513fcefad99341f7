"""Run the command ``clearcap`` as ``python -m clearcap``."""

from campaign.__main__ import main

if __name__ == "__main__":
    main()
