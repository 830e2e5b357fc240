"""``python -m headless``."""

if __name__ == "__main__":  # processes of a pool import it, too
    from .interrupt import follow_starter, quietly

    follow_starter()
    quietly()  # before the first import that takes a while

    from .cli import main

    raise SystemExit(main())
