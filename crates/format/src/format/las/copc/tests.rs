use std::collections::BTreeSet;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use las::{Bounds, BoundsSelection, CopcReader, LodSelection, Vector};

use super::copc_sink;
use super::file::{CopcFile, Extent};
use super::octree::{Cell, Cube, Keyed, divide};
use crate::cloud::PointCloud;
use crate::error::Result;
use crate::format::cloud::sink::{CloudClock, CloudPoint, CloudShape};
use crate::format::input::Input;
use crate::format::las::chunks;
use crate::format::las::file::LasFile;
use crate::format::las::points::{las_count, read_las, stream_las};
use crate::format::las::record::{Placement, append_record};
use crate::format::mutation::for_each_damaged;
use crate::format::text::civil::unix_from_adjusted_gps_s;
use crate::geometry::Vec3;

/// Uniformly distributed numbers from 0 to 1, the same in each run.
fn draws() -> impl FnMut() -> f64 {
    let mut state = 1u64;
    move || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (state >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// A surface with a dense spot, a body and two points far from the others.
fn cloud(count: usize) -> Vec<Vec3> {
    let mut draw = draws();
    let origin = Vec3::new(450_000.0, 5_600_000.0, 90.0);
    let mut points: Vec<Vec3> = (0..count)
        .map(|i| {
            let (x, y, z) = (draw(), draw(), draw());
            origin
                + match i % 4 {
                    0 | 1 => Vec3::new(100.0 * x, 60.0 * y, (x * 9.0).sin()),
                    2 => Vec3::new(40.0 + x, 30.0 + y, 0.001 * z),
                    _ => Vec3::new(10.0 * x, 10.0 * y, 10.0 * z),
                }
        })
        .collect();
    points.push(origin - Vec3::new(300.0, 0.0, 0.0));
    points.push(origin + Vec3::new(0.0, 0.0, 250.0));
    points
}

fn write(path: &Path, points: &[Vec3], clock: CloudClock) {
    let first = points[0];
    let shape = CloudShape {
        low: points.iter().fold(first, |low, p| low.inf(p)),
        high: points.iter().fold(first, |high, p| high.sup(p)),
        has_time: true,
        clock,
        ..CloudShape::default()
    };
    let mut sink = copc_sink(path, &shape).unwrap();
    for (i, position) in points.iter().enumerate() {
        let point = CloudPoint {
            position: *position,
            time_s: i as f64,
            intensity: 0.0,
            values: &[],
        };
        sink.push(&point).unwrap();
    }
    sink.finish().unwrap();
}

#[test]
fn cells_contain_their_points_and_a_query_by_box_finds_all() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.copc.laz");
    let points = cloud(1_000_000);
    write(&path, &points, CloudClock::Unknown);
    let mut reader = CopcReader::from_path(&path).unwrap();
    let info = reader.header().copc_info_vlr().unwrap();
    assert_eq!(info.gpstime_minimum, 0.0);
    assert_eq!(info.gpstime_maximum, (points.len() - 1) as f64);
    let entries: Vec<_> = reader.hierarchy_entries().collect();
    let levels = entries.iter().map(|entry| entry.key.l).max().unwrap();
    assert!(levels > 3, "{levels} levels");
    let keys: BTreeSet<_> = entries
        .iter()
        .map(|entry| [entry.key.l, entry.key.x, entry.key.y, entry.key.z])
        .collect();
    assert_eq!(keys.len(), entries.len());
    let mut seen = vec![false; points.len()];
    for entry in &entries {
        let parent = entry.key.parent();
        assert!(keys.contains(&[parent.l, parent.x, parent.y, parent.z]));
        let cell = entry.key.bounds(&info);
        let chunk = reader.read_entry(entry).unwrap();
        let mut subcells = BTreeSet::new();
        let mut count = 0;
        for point in chunk.points() {
            let point = point.unwrap();
            let inside = |v: f64, low: f64, high: f64| low < v && v < high;
            assert!(
                inside(point.x, cell.min.x, cell.max.x)
                    && inside(point.y, cell.min.y, cell.max.y)
                    && inside(point.z, cell.min.z, cell.max.z),
                "{point:?} {cell:?}"
            );
            let spacing = info.spacing / f64::from(1 << entry.key.l);
            subcells.insert([
                ((point.x - cell.min.x) / spacing) as i64,
                ((point.y - cell.min.y) / spacing) as i64,
                ((point.z - cell.min.z) / spacing) as i64,
            ]);
            let number = point.gps_time.unwrap() as usize;
            assert!(!std::mem::replace(&mut seen[number], true));
            count += 1;
        }
        assert_eq!(count, entry.point_count);
        let is_child = |e: &las::copc::Entry| e.key.l > entry.key.l && e.key.parent() == entry.key;
        let has_children = entries.iter().any(is_child);
        if has_children {
            // Boundaries of subcells are those of finest cells, to within a rounding.
            let lost = count as usize - subcells.len();
            assert!(lost * 1000 <= count as usize, "{lost} of {count}");
        }
    }
    assert!(seen.iter().all(|seen| *seen));
    let (low, high) = (
        [450_035.0, 5_600_020.0, 85.0],
        [450_055.0, 5_600_031.0, 90.5],
    );
    let bounds = Bounds {
        min: Vector {
            x: low[0],
            y: low[1],
            z: low[2],
        },
        max: Vector {
            x: high[0],
            y: high[1],
            z: high[2],
        },
    };
    let found = reader
        .query(LodSelection::All, BoundsSelection::Within(bounds))
        .unwrap();
    let mut found: Vec<usize> = found
        .points()
        .map(|point| point.unwrap().gps_time.unwrap() as usize)
        .collect();
    found.sort_unstable();
    let inside = |p: &Vec3| (0..3).all(|axis| low[axis] <= p[axis] && p[axis] <= high[axis]);
    let expected: Vec<usize> = (0..points.len()).filter(|i| inside(&points[*i])).collect();
    assert!(expected.len() > 100_000);
    assert!(found == expected, "{} of {}", found.len(), expected.len());
}

#[test]
fn the_reader_of_las_returns_all_points() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.copc.laz");
    // More points than one thread decodes at a time, in chunks of different sizes.
    let points = cloud(1_200_000);
    write(&path, &points, CloudClock::AdjustedGps);
    let cloud = read_las(&Input::from(&path)).unwrap();
    assert_eq!(cloud.points.len(), points.len());
    let mut seen = vec![false; points.len()];
    for (p, time_s) in cloud.points.iter().zip(&cloud.time_s) {
        let number = (*time_s - unix_from_adjusted_gps_s(0.0)) as usize;
        assert!((p - points[number]).amax() <= 0.5e-5 + 1e-9);
        assert!(!std::mem::replace(&mut seen[number], true));
    }
    let mut streamed = 0;
    let mut each = |piece: &[Vec3]| {
        assert_eq!(piece[0], cloud.points[streamed]);
        streamed += piece.len();
        Ok(())
    };
    stream_las(&path, &mut each).unwrap();
    assert_eq!(streamed, points.len());
    let header = std::fs::read(&path).unwrap();
    assert_eq!(header[6], 0x11, "WKT and adjusted standard GPS time");
}

/// Writes points on a line, as many in each cell as `sizes` says.
fn write_cells(path: &Path, sizes: &[usize]) {
    let mut extent = Extent::default();
    let mut records = Vec::new();
    for i in 0..sizes.iter().sum::<usize>() {
        let (steps, time_s) = ([i as i32 * 7, (i * i % 11) as i32, 3], i as f64);
        extent.include(steps, time_s);
        let mut record = Vec::new();
        append_record(steps, Some(time_s), i as f32, 0, &mut record);
        records.push(record);
    }
    let mut end = 0;
    let cells: Vec<Cell> = (0..)
        .zip(sizes)
        .map(|(level, size)| {
            let start = end;
            end += size;
            Cell {
                level,
                at: [0; 3],
                points: start..end,
            }
        })
        .collect();
    let points: Vec<Keyed> = (0..end as u32).map(|number| (0, number)).collect();
    let file = CopcFile {
        path,
        placement: Placement::at(path, &Vec3::zeros(), 0.001).unwrap(),
        clock: CloudClock::Unknown,
        dimensions: &[],
        wkt: None,
        extent,
        cube: Cube::around(extent.low, extent.high),
    };
    let out = BufWriter::new(File::create(path).unwrap());
    let record = |number: u32| &records[number as usize][..];
    file.write(out, &cells, &points, &record).unwrap();
}

/// As [`read_las`], on one thread.
fn read_in_order(path: &Path) -> Result<PointCloud> {
    las_count(path)?;
    let mut cloud = PointCloud::default();
    let mut file = LasFile::reopen(&Input::from(path))?;
    while file.read(7, |_, point| {
        cloud.points.push(point.position);
        cloud.intensity.push(point.intensity);
        cloud.time_s.push(point.time_s);
        Ok(())
    })? > 0
    {}
    Ok(cloud)
}

#[test]
fn chunks_give_the_same_points_in_parallel_and_in_order() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.copc.laz");
    for sizes in [&[1][..], &[5], &[3, 50, 1, 20], &[100, 1, 1, 99, 300]] {
        write_cells(&path, sizes);
        let file = LasFile::open(&Input::from(&path)).unwrap();
        assert!(chunks::check(&Input::from(&path), file.header(), file.bytes_total()).unwrap());
        let found = read_las(&Input::from(&path)).unwrap();
        assert_eq!(found.points.len(), sizes.iter().sum::<usize>());
        assert!(found.time_s.iter().enumerate().all(|(i, t)| *t == i as f64));
        assert_eq!(found, read_in_order(&path).unwrap());
    }
}

#[test]
fn damaged_chunks_give_the_same_points_in_parallel_and_in_order() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.copc.laz");
    write_cells(&path, &[30, 1, 60, 25]);
    let valid = std::fs::read(&path).unwrap();
    let mut read = 0;
    for_each_damaged(&path, &valid, 2000, || {
        match (read_las(&Input::from(&path)), read_in_order(&path)) {
            (Ok(found), Ok(expected)) => {
                assert_eq!(found.points, expected.points);
                assert_eq!(found.intensity, expected.intensity);
                read += 1;
            }
            (Err(_), Err(_)) => {}
            (found, expected) => panic!("{found:?} {expected:?}"),
        }
    });
    assert!(read > 100, "{read}");
}

#[test]
fn bytes_do_not_depend_on_the_number_of_threads() {
    let dir = tempfile::tempdir().unwrap();
    let points = cloud(250_000);
    let bytes = |threads: usize| {
        let path = dir.path().join(format!("{threads}.copc.laz"));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let pool = pool.build().unwrap();
        pool.install(|| write(&path, &points, CloudClock::Unknown));
        std::fs::read(&path).unwrap()
    };
    assert!(bytes(1) == bytes(3));
}

#[test]
fn points_at_one_place_are_one_cell() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.copc.laz");
    let mut points = vec![Vec3::new(1.0, 2.0, 3.0); 250_000];
    write(&path, &points, CloudClock::Unknown);
    assert_eq!(
        read_las(&Input::from(&path)).unwrap().points.len(),
        points.len()
    );
    // One distant point makes as many levels as a key has bits per axis.
    points.push(Vec3::new(1.0, 2.0, 700.0));
    write(&path, &points, CloudClock::Unknown);
    assert_eq!(
        read_las(&Input::from(&path)).unwrap().points.len(),
        points.len()
    );
    let reader = CopcReader::from_path(&path).unwrap();
    let total: i32 = reader.hierarchy_entries().map(|e| e.point_count).sum();
    assert_eq!(total as usize, points.len());
}

#[test]
fn cubes_hold_their_points_and_are_hardly_larger() {
    let most = i32::MAX;
    let spans = [
        ([0; 3], [0; 3]),
        ([-5, 7, 9], [-5, 8, 9]),
        ([0; 3], [1_000_000, 3, 70]),
        ([-most; 3], [most; 3]),
        ([most - 1, 0, 0], [most, 40, 2]),
    ];
    for (low, high) in spans {
        let cube = Cube::around(low, high);
        let extent = (0..3).map(|a| i64::from(high[a]) - i64::from(low[a]) + 1);
        let extent = extent.max().unwrap();
        assert!(cube.side() >= extent, "{cube:?}");
        assert!(cube.side() as f64 <= extent as f64 * 1.032, "{cube:?}");
        let centre = cube.centre();
        for axis in 0..3 {
            let half = cube.side() as f64 / 2.0;
            assert!(f64::from(low[axis]) > centre[axis] - half);
            assert!(f64::from(high[axis]) < centre[axis] + half);
        }
        assert_eq!(cube.key(low), 0);
        assert!(cube.key(high) < 1 << 63);
    }
    // x is the lowest of three bits.
    let cube = Cube::around([0; 3], [(1 << 26) - 1; 3]);
    assert_eq!(cube.key([32, 0, 0]), 1);
    assert_eq!(cube.key([0, 64, 0]), 0b1_0000);
    assert_eq!(cube.key([0, 0, (1 << 26) - 1]), 0x4924_9249_2492_4924);
}

#[test]
fn a_small_cloud_is_one_cell_in_the_order_of_the_points() {
    let cube = Cube::around([0; 3], [99; 3]);
    let mut points: Vec<_> = (0..100u32)
        .map(|i| (cube.key([99 - i as i32, 0, 0]), i))
        .collect();
    let cells = divide(&cube, &mut points);
    assert_eq!(cells.len(), 1);
    assert!(points.iter().enumerate().all(|(at, p)| p.1 as usize == at));
    assert!(divide(&cube, &mut []).is_empty());
}
