"""Entry point of `python -m perceptree` and `torchrun -m perceptree`."""

from perceptree.cli import main

if __name__ == "__main__":
    main()
