"""Run the command ``physic`` as ``python -m physic_core``."""

if __name__ == "__main__":
    import sys

    # Python puts the current folder first, and a module in it would hide an installed one.
    if not sys.flags.safe_path:
        del sys.path[0]

    from physic_core.cli.process import main_of_process

    main_of_process()
