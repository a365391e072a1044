"""ROS 2 (Humble) message definitions, as viewers need them to decode the messages."""

IMU = "sensor_msgs/msg/Imu"
JOINT_STATE = "sensor_msgs/msg/JointState"
TF_MESSAGE = "tf2_msgs/msg/TFMessage"
STRING = "std_msgs/msg/String"
LOG = "rcl_interfaces/msg/Log"

_FIELDS = {
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec\n",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Quaternion": "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n",
    "geometry_msgs/Transform": (
        "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n"
    ),
    "geometry_msgs/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n"
    ),
    IMU: (
        "std_msgs/Header header\n"
        "geometry_msgs/Quaternion orientation\n"
        "float64[9] orientation_covariance\n"
        "geometry_msgs/Vector3 angular_velocity\n"
        "float64[9] angular_velocity_covariance\n"
        "geometry_msgs/Vector3 linear_acceleration\n"
        "float64[9] linear_acceleration_covariance\n"
    ),
    JOINT_STATE: (
        "std_msgs/Header header\n"
        "string[] name\n"
        "float64[] position\n"
        "float64[] velocity\n"
        "float64[] effort\n"
    ),
    TF_MESSAGE: "geometry_msgs/TransformStamped[] transforms\n",
    STRING: "string data\n",
    LOG: (
        "byte DEBUG=10\nbyte INFO=20\nbyte WARN=30\nbyte ERROR=40\nbyte FATAL=50\n"
        "builtin_interfaces/Time stamp\n"
        "uint8 level\n"
        "string name\n"
        "string msg\n"
        "string file\n"
        "string function\n"
        "uint32 line\n"
    ),
}
_SEPARATOR = "=" * 80 + "\n"


def definition(type_name: str) -> str:
    """The `ros2msg` text of a type: its fields, then those of every type it contains.

    Raises
    ------
    KeyError
        Not one of the types written here.
    """
    names = _with_parts(type_name)
    parts = [f"MSG: {name}\n{_FIELDS[name]}" for name in names[1:]]
    return _SEPARATOR.join([_FIELDS[type_name], *parts])


def _with_parts(type_name: str) -> list[str]:
    """`type_name` and the types below it, each once, in order of appearance."""
    names = [type_name]
    for name in names:  # grows while it is walked
        used = (line.split()[0].removesuffix("[]") for line in _FIELDS[name].splitlines())
        names += [part for part in dict.fromkeys(used) if part in _FIELDS and part not in names]
    return names
