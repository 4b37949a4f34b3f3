"""Labels in the forms of labelling tools and of other trainers: read, divided, joined, written.

Every form is read into the records of `perceptree.data.coco`, and every form is written from them.
A reader turns the files of a tool into the content of a COCO file, so that names, ids, masks and
broken entries are treated in one place, `perceptree.data.parsing`.
"""

__all__: list[str] = []
