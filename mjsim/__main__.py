"""``python -m mjsim``: the console command, also where its folder is not on the path."""

from mjsim.cli.main import main

if __name__ == "__main__":
    main(prog_name="mjsim")
