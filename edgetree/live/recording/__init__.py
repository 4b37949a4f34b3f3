"""Keep the input of the seconds around a mark, so that a wrong measurement can be reproduced.

from edgetree.live.recording import FrameRecorder

recorder = FrameRecorder(Path("recordings"))
for result in pipeline:
    recorder.write(result)
    if is_wrong(result):
        recorder.mark("diameter")
recorder.close()
"""

from edgetree.live.recording.file import RECORDING_SCHEMA, run_record
from edgetree.live.recording.recorder import FrameRecorder, RecorderStatus

__all__ = ["RECORDING_SCHEMA", "FrameRecorder", "RecorderStatus", "run_record"]
