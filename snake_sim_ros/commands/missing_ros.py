"""What a command says that needs ROS 2 where it is not installed."""

from snake_sim_ros.scene.checked_records import ParameterError


def missing_ros(what: str, command: str, error: ImportError) -> ParameterError:
    """Return what to raise where ROS 2 is missing."""
    return ParameterError(
        f'{what} needs ROS 2 ({error}): source a ROS 2 installation, or ./run {command}'
    )
