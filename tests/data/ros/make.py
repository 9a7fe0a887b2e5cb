"""Writes the sample bags of this folder with other programs.

pip install rosbags mcap mcap-ros2-support numpy lz4 zstandard
python make.py            (in this folder)

The values are formulas of the index i of a message and of the index k of a point, which the tests
repeat. Message i has the stamp 1700000000 s + 0.01 s * i.
"""
from pathlib import Path

import numpy as np
import zstandard
from mcap.writer import CompressionType, IndexType, Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import Writer as Writer2, StoragePlugin, CompressionMode, CompressionFormat
from rosbags.typesys import Stores, get_typestore

HERE = Path(__file__).parent
START_S = 1_700_000_000
COUNT = 12


def messages(store, ros):
    """(topic, type, stamp in ns, message), in time order."""
    t = store.types
    Header, Time = t["std_msgs/msg/Header"], t["builtin_interfaces/msg/Time"]
    V, Q = t["geometry_msgs/msg/Vector3"], t["geometry_msgs/msg/Quaternion"]
    P, Pose = t["geometry_msgs/msg/Point"], t["geometry_msgs/msg/Pose"]
    F, Cloud = t["sensor_msgs/msg/PointField"], t["sensor_msgs/msg/PointCloud2"]

    def header(ns, frame):
        args = dict(stamp=Time(sec=ns // 10**9, nanosec=ns % 10**9), frame_id=frame)
        return Header(seq=3, **args) if ros == 1 else Header(**args)

    def cloud(ns, layout, rows, big=False, pad=0):
        """layout: (name, datatype, numpy kind); rows: list of rows of tuples."""
        kinds = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
        order = ">" if big else "<"
        fields, offset, spec = [], 0, []
        for name, datatype in layout:
            fields.append(F(name=name, offset=offset, datatype=datatype, count=1))
            spec.append((name, order + kinds[datatype]))
            offset += int(kinds[datatype][1])
        dtype = np.dtype(spec)
        data = b"".join(np.array(row, dtype=dtype).tobytes() + bytes(pad) for row in rows)
        return Cloud(header=header(ns, "lidar"), height=len(rows), width=len(rows[0]), fields=fields,
                     is_bigendian=big, point_step=offset, row_step=offset * len(rows[0]) + pad,
                     data=np.frombuffer(data, dtype=np.uint8), is_dense=True)

    out = []
    for i in range(COUNT):
        ns = START_S * 10**9 + i * 10**7
        add = lambda topic, kind, message: out.append((topic, kind, ns, message))
        q = Q(x=0.0, y=0.0, z=float(np.sin(0.05 * i)), w=float(np.cos(0.05 * i)))
        position = P(x=1.0 + 0.5 * i, y=-2.0 * i, z=0.25)
        cov = np.zeros(36)
        if i % 2 == 0:
            cov[::7] = [0.01, 0.04, 0.09, 0.0001, 0.0004, 0.0009]
        pose = Pose(position=position, orientation=q)
        with_cov = t["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=cov)
        twist = t["geometry_msgs/msg/TwistWithCovariance"](
            twist=t["geometry_msgs/msg/Twist"](linear=V(x=1.0, y=2.0, z=3.0), angular=V(x=0.0, y=0.0, z=0.0)),
            covariance=np.zeros(36))
        add("/imu", "sensor_msgs/msg/Imu", t["sensor_msgs/msg/Imu"](
            header=header(ns, "imu"), orientation=q, orientation_covariance=np.array([-1.0] + [0.0] * 8),
            angular_velocity=V(x=0.1 * i, y=-0.2, z=0.001 * i * i), angular_velocity_covariance=np.zeros(9),
            linear_acceleration=V(x=0.5 - i, y=0.25 * i, z=9.81), linear_acceleration_covariance=np.zeros(9)))
        add("/odom", "nav_msgs/msg/Odometry", t["nav_msgs/msg/Odometry"](
            header=header(ns, "odom"), child_frame_id="base_link", pose=with_cov, twist=twist))
        add("/pose", "geometry_msgs/msg/PoseStamped", t["geometry_msgs/msg/PoseStamped"](
            header=header(ns, "map"), pose=pose))
        add("/pose_cov", "geometry_msgs/msg/PoseWithCovarianceStamped",
            t["geometry_msgs/msg/PoseWithCovarianceStamped"](header=header(ns, "map_frame"), pose=with_cov))
        add("/transform", "geometry_msgs/msg/TransformStamped", t["geometry_msgs/msg/TransformStamped"](
            header=header(ns, "map"), child_frame_id="base",
            transform=t["geometry_msgs/msg/Transform"](
                translation=V(x=position.x, y=position.y, z=position.z), rotation=q)))
        status = t["sensor_msgs/msg/NavSatStatus"](status=-1 if i == 0 else 0, service=1)
        add("/fix", "sensor_msgs/msg/NavSatFix", t["sensor_msgs/msg/NavSatFix"](
            header=header(ns, "gnss"), status=status, latitude=50.5 + 1e-6 * i, longitude=7.25 - 1e-6 * i,
            altitude=60.125 + i, position_covariance=np.array([1.0, 0.1, 0.2, 0.1, 2.0, 0.3, 0.2, 0.3, 4.0]),
            position_covariance_type=0 if i == 1 else 3))
        if i % 3 == 0:
            ranges = np.array([1.0 + 0.5 * k for k in range(5)] + [np.inf, 99.0], dtype=np.float32)
            add("/scan", "sensor_msgs/msg/LaserScan", t["sensor_msgs/msg/LaserScan"](
                header=header(ns, "laser"), angle_min=-0.5, angle_max=1.0, angle_increment=0.25,
                time_increment=0.0009765625, scan_time=0.025, range_min=0.5, range_max=30.0,
                ranges=ranges, intensities=np.arange(7, dtype=np.float32) * 10))
            n = 4
            xyz = [("x", 7), ("y", 7), ("z", 7)]
            at = lambda j, k: (1.0 + k, 2.0 * j + 0.5, -3.0)
            # Two rings that measure at the same times; the last point of each was not measured.
            ouster = [[at(j, k) + (100.0 * j + k, 5_000_000 * k) if k < 3 else (0.0, 0.0, 0.0, 0.0, 0)
                       for k in range(n)] for j in range(2)]
            add("/ouster", "sensor_msgs/msg/PointCloud2",
                cloud(ns, xyz + [("intensity", 7), ("t", 6)], ouster, pad=4))
            velodyne = [[at(0, k) + (k, 0.0078125 * (k - 3)) if k else (np.nan, 0.0, 0.0, 0, 0.0)
                         for k in range(n)]]
            add("/velodyne", "sensor_msgs/msg/PointCloud2",
                cloud(ns, xyz + [("intensity", 2), ("time", 7)], velodyne))
            livox = [[at(0, k) + (k + 7, float(ns + 1_000_000 * k)) for k in range(n)]]
            add("/livox", "sensor_msgs/msg/PointCloud2",
                cloud(ns, xyz + [("reflectivity", 4), ("timestamp", 8)], livox))
            hesai = [[at(0, k) + (k + 7, START_S + 0.01 * i + 0.001 * k) for k in range(n)]]
            add("/hesai", "sensor_msgs/msg/PointCloud2",
                cloud(ns, [(a, 8) for a in "xyz"] + [("intensity", 7), ("timestamp", 8)], hesai, big=True))
            add("/offset", "sensor_msgs/msg/PointCloud2",
                cloud(ns, xyz + [("offset_time", 6)], [[at(0, k) + (2_000_000 * k,) for k in range(n)]]))
            add("/untimed", "sensor_msgs/msg/PointCloud2", cloud(ns, xyz, [[at(0, k) for k in range(n)]]))
    return out


def ros1(name, compression, chunk=None):
    store = get_typestore(Stores.ROS1_NOETIC)
    path = HERE / name
    path.unlink(missing_ok=True)
    writer = Writer1(path)
    if compression:
        writer.set_compression(compression)
    if chunk:
        writer.chunk_threshold = chunk
    with writer:
        connections = {}
        for topic, kind, ns, message in messages(store, 1):
            if topic not in connections:
                # The definitions would be most of such a small file, and its readers do not need them.
                md5 = store.generate_msgdef(kind, ros_version=1)[1]
                connections[topic] = writer.add_connection(topic, kind, msgdef="# omitted", md5sum=md5)
            writer.write(connections[topic], ns, store.serialize_ros1(message, kind))
    return path


def mcap(name, compression, chunked=True, summary=True, big=False, chunk_size=4000, cdr=True):
    store = get_typestore(Stores.ROS2_HUMBLE if cdr else Stores.ROS1_NOETIC)
    path = HERE / name
    with path.open("wb") as file:
        writer = McapWriter(
            file, chunk_size=chunk_size, compression=compression, use_chunking=chunked,
            index_types=IndexType.ALL if summary else IndexType.NONE, repeat_channels=summary,
            repeat_schemas=summary, use_statistics=summary, use_summary_offsets=summary)
        writer.start(profile="ros2" if cdr else "ros1")
        schemas, channels = {}, {}
        for topic, kind, ns, message in messages(store, 2 if cdr else 1):
            if kind not in schemas:
                label = kind if cdr else kind.replace("/msg/", "/")
                schemas[kind] = writer.register_schema(label, "ros2msg" if cdr else "ros1msg", b"# omitted")
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "cdr" if cdr else "ros1", schemas[kind])
            data = (store.serialize_cdr(message, kind, little_endian=not big) if cdr
                    else store.serialize_ros1(message, kind))
            writer.add_message(channels[topic], ns, bytes(data), ns)
        writer.finish()
    return path


def rosbag2(name, page_size=None, mode=None, part=slice(None)):
    """MCAP or SQLite by the writer of the package rosbags, as one file, with a part of the messages. Returns its list."""
    import shutil, sqlite3, tempfile
    is_mcap = name.endswith(".mcap")
    store = get_typestore(Stores.ROS2_HUMBLE)
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / "bag"
        writer = Writer2(bag, version=9, storage_plugin=StoragePlugin.MCAP if is_mcap else StoragePlugin.SQLITE3)
        if is_mcap or mode:
            writer.set_compression(mode or CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with writer:
            connections = {}
            for topic, kind, ns, message in messages(store, 2)[part]:
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=store)
                writer.write(connections[topic], ns, store.serialize_cdr(message, kind))
        shutil.copy(next(bag.glob("*" + Path(name).suffix)), HERE / name)
        metadata = (bag / "metadata.yaml").read_text()
    if page_size:
        # Messages then continue on pages of their own, and the tables have pages above pages.
        with sqlite3.connect(HERE / name) as database:
            database.execute(f"PRAGMA page_size={page_size}")
            database.execute("VACUUM")
    return metadata


def packed(name):
    """Compresses a file as a whole."""
    path = HERE / name
    path.with_name(name + ".zst").write_bytes(zstandard.ZstdCompressor(level=19).compress(path.read_bytes()))
    path.unlink()


def split():
    """A recording in two files that are compressed as a whole, named as rosbag2 does; rosbags writes one file only."""
    (HERE / "split").mkdir(exist_ok=True)
    parts = [slice(0, 50), slice(50, None)]
    for number, part in enumerate(parts):
        text = rosbag2(f"split/drive_{number}.db3.zstd", mode=CompressionMode.FILE, part=part)
    names = "".join(f"  - drive_{number}.db3.zstd\n" for number in range(len(parts)))
    (HERE / "split" / "metadata.yaml").write_text(text.replace("  - bag.db3.zstd\n", names))


if __name__ == "__main__":
    ros1("plain.bag", None, 4000)
    ros1("bz2.bag", Writer1.CompressionFormat.BZ2)
    ros1("lz4.bag", Writer1.CompressionFormat.LZ4, 8000)
    mcap("zstd.mcap", CompressionType.ZSTD)
    mcap("lz4.mcap", CompressionType.LZ4)
    mcap("plain.mcap", CompressionType.NONE)
    mcap("unchunked_big_endian.mcap", CompressionType.NONE, chunked=False, big=True)
    mcap("no_summary.mcap", CompressionType.ZSTD, summary=False)
    mcap("ros1.mcap", CompressionType.LZ4, cdr=False)
    rosbag2("rosbags.mcap")
    rosbag2("rosbags.db3")
    packed("rosbags.db3")
    for name in ["messages.db3", "messages.mcap"]:
        rosbag2(name, mode=CompressionMode.MESSAGE)
        packed(name)
    split()
    rosbag2("small_pages.db3", 512)
    for path in sorted(HERE.glob("*.bag")) + sorted(HERE.glob("*.mcap")) + sorted(HERE.glob("*.db3*")):
        print(path.name, path.stat().st_size)
