"""What the content of a picture file states, found before a decoder takes memory for its pixels.

One module for each family of formats. A picture whose size cannot be told with certainty is not
given to a decoder.
"""

__all__: list[str] = []
