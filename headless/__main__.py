"""``python -m headless``."""

if __name__ == "__main__":  # processes of a pool import it, too
    import _signal as signal  # in the interpreter itself: signal takes a millisecond to be imported

    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # no traceback of an import
        signal.signal(signal.SIGINT, signal.SIG_DFL)

    from .interrupt import quietly

    quietly()  # before the first import that takes a while

    from .cli import main

    raise SystemExit(main())
