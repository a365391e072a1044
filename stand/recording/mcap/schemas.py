"""ROS 2 (Humble) message definitions, as viewers need them to decode the messages."""

IMU = "sensor_msgs/msg/Imu"
JOINT_STATE = "sensor_msgs/msg/JointState"
TF_MESSAGE = "tf2_msgs/msg/TFMessage"
STRING = "std_msgs/msg/String"
UINT8 = "std_msgs/msg/UInt8"
LOG = "rcl_interfaces/msg/Log"
NAV_SAT_FIX = "sensor_msgs/msg/NavSatFix"
TWIST_STAMPED = "geometry_msgs/msg/TwistStamped"
TWIST_WITH_COVARIANCE_STAMPED = "geometry_msgs/msg/TwistWithCovarianceStamped"

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
    "geometry_msgs/Twist": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n",
    "geometry_msgs/TwistWithCovariance": "geometry_msgs/Twist twist\nfloat64[36] covariance\n",
    "sensor_msgs/NavSatStatus": (
        "int8 STATUS_NO_FIX=-1\nint8 STATUS_FIX=0\nint8 STATUS_SBAS_FIX=1\n"
        "int8 STATUS_GBAS_FIX=2\n"
        "int8 status\n"
        "uint16 SERVICE_GPS=1\nuint16 SERVICE_GLONASS=2\nuint16 SERVICE_COMPASS=4\n"
        "uint16 SERVICE_GALILEO=8\n"
        "uint16 service\n"
    ),
    NAV_SAT_FIX: (
        "std_msgs/Header header\n"
        "sensor_msgs/NavSatStatus status\n"
        "float64 latitude\n"
        "float64 longitude\n"
        "float64 altitude\n"
        "float64[9] position_covariance\n"
        "uint8 COVARIANCE_TYPE_UNKNOWN=0\nuint8 COVARIANCE_TYPE_APPROXIMATED=1\n"
        "uint8 COVARIANCE_TYPE_DIAGONAL_KNOWN=2\nuint8 COVARIANCE_TYPE_KNOWN=3\n"
        "uint8 position_covariance_type\n"
    ),
    TWIST_STAMPED: "std_msgs/Header header\ngeometry_msgs/Twist twist\n",
    TWIST_WITH_COVARIANCE_STAMPED: (
        "std_msgs/Header header\ngeometry_msgs/TwistWithCovariance twist\n"
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
    UINT8: "uint8 data\n",
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
