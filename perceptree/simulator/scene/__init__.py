"""What stands where, under which sky: the description that knows no mesh and no renderer."""

__all__: list[str] = []
