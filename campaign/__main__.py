"""``python -m campaign`` is ``clearcap``."""

from campaign.cli import main

if __name__ == "__main__":
    main()
