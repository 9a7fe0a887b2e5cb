//! LAS and LAZ: counts, versions, extra dimensions, records.

use super::{assert_points, case, converted, error, read};
use boresight::format::{CloudRows, read_cloud};
use boresight::progress::Silent;

use crate::common::boresight;

#[test]
fn the_number_of_points_is_that_of_64_bits() {
    let (cloud, remarks) = read("las14-legacy-count/b14_legacy5.las");
    assert_eq!(cloud.points.len(), 20);
    assert!(remarks.contains("20 points (64 bits) and 5"), "{remarks}");
    let path = case("las14-legacy-count/b14_legacy5.las");
    let run = boresight(&["inspect", path.to_str().unwrap()]);
    assert!(run.out.contains("rows     20") && run.out.contains("64 bits"));
    // A copy has all points, too, and says so.
    let folder = tempfile::tempdir().unwrap();
    let copy = folder.path().join("a.laz");
    let run = boresight(&["convert", path.to_str().unwrap(), copy.to_str().unwrap()]);
    assert!(run.err.contains("20 points (64 bits)"), "{}", run.err);
    assert_eq!(read_cloud(&copy).unwrap().points, cloud.points);
}

#[test]
fn version_1_5_is_read() {
    let (cloud, _) = read("las15/v15.las");
    assert_eq!(cloud.points.len(), 5);
    assert!((cloud.points[0].x - 364_500.123).abs() < 1e-9);
    assert_eq!(cloud.intensity[4], 65_535.0);
}

#[test]
fn a_wrong_number_of_records_is_named() {
    let text = error("vlr_count/vl.las");
    assert!(
        text.contains("byte 100: found 7 variable-length records in the 0 bytes"),
        "{text}"
    );
}

#[test]
fn no_data_are_empty() {
    let (header, rows, _) = converted("las_nodata/nod.las");
    assert!(header.ends_with(",h,amp,u8s,dbl"), "{header}");
    assert!(rows[0].ends_with(",-1.25,1,0.5,0"), "{}", rows[0]);
    assert!(rows[4].ends_with(",3,,1,0.000000004"), "{}", rows[4]);
    // As NaN or an announced value also in the formats without empty cells, and for values with a scale.
    for output in ["a.copc.laz", "a.ply", "a.e57", "a.parquet"] {
        let folder = tempfile::tempdir().unwrap();
        let (scaled, output) = (folder.path().join("scaled.las"), folder.path().join(output));
        let mut bytes = std::fs::read(case("las_nodata/nod.las")).unwrap();
        // The third dimension, of bytes with the scale 0.01: 100 stands for no data.
        let entry = 375 + 54 + 2 * 192;
        bytes[entry + 3] |= 1;
        bytes[entry + 40] = 100;
        std::fs::write(&scaled, bytes).unwrap();
        let mut seen = Vec::new();
        CloudRows::open(&scaled)
            .unwrap()
            .for_each(&Silent, &mut |point| {
                seen.push(point.values[2].number());
                Ok(())
            })
            .unwrap();
        assert!(seen[1].is_nan() && seen[4].is_nan() && (seen[2] - 2.55).abs() < 1e-12);
        let run = boresight(&[
            "convert",
            scaled.to_str().unwrap(),
            output.to_str().unwrap(),
        ]);
        assert_eq!(run.code, 0, "{}", run.err);
        if output.ends_with("a.copc.laz") {
            let mut missing = [0; 4];
            CloudRows::open(&output)
                .unwrap()
                .for_each(&Silent, &mut |point| {
                    for (count, value) in missing.iter_mut().zip(point.values) {
                        *count += usize::from(value.number().is_nan());
                    }
                    Ok(())
                })
                .unwrap();
            assert_eq!(missing, [0, 1, 2, 0]);
        }
    }
}

#[test]
fn integers_of_64_bits_are_exact() {
    let (header, rows, _) = converted("las_u64_csv/u64.las");
    assert!(header.ends_with(",u64,i64,f32"), "{header}");
    for (row, expected) in rows.iter().zip([
        ",9223372036854775809,-9007199254740993,",
        ",9007199254740993,4611686018427387905,",
        ",1,0,",
        ",2,1,",
        ",3,2,",
    ]) {
        assert!(row.contains(expected), "{row}");
    }
    // Through COPC and back to text.
    let folder = tempfile::tempdir().unwrap();
    let [copc, ply, text] = ["a.copc.laz", "a.ply", "a.csv"].map(|name| folder.path().join(name));
    let input = case("las_u64_csv/u64.las");
    for (from, to) in [(&input, &copc), (&copc, &text), (&input, &ply)] {
        let run = boresight(&["convert", from.to_str().unwrap(), to.to_str().unwrap()]);
        assert_eq!(run.code, 0, "{}", run.err);
        let is_said = run.err.contains("u64, i64 are written as double");
        assert_eq!(is_said, to == &ply, "{}", run.err);
    }
    let text = std::fs::read_to_string(&text).unwrap();
    assert!(
        text.contains(",9223372036854775809,-9007199254740993,"),
        "{text}"
    );
}

#[test]
fn arrays_of_extra_dimensions_are_kept() {
    let (header, rows, _) = converted("las_array_extra/arr.las");
    assert!(header.ends_with(",nrm_0,nrm_1,nrm_2"), "{header}");
    assert!(rows[1].ends_with(",3,4,5") && rows[4].ends_with(",12,13,14"));
}

#[test]
fn extra_dimensions_with_one_name_are_told_apart() {
    let (header, rows, said) = converted("las_dup_extra/dup.las");
    assert!(header.ends_with(",aaa,aaa_2"), "{header}");
    assert!(rows[2].ends_with(",2,12"), "{}", rows[2]);
    assert!(
        said.contains("`aaa` has the name of another value"),
        "{said}"
    );
}

#[test]
fn an_extra_dimension_may_be_called_intensity() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.las");
    let mut bytes = std::fs::read(case("las_dup_extra/dup.las")).unwrap();
    let name = 375 + 54 + 4;
    bytes[name..name + 9].copy_from_slice(b"Intensity");
    std::fs::write(&path, bytes).unwrap();
    let output = folder.path().join("a.csv");
    let run = boresight(&["convert", path.to_str().unwrap(), output.to_str().unwrap()]);
    assert_eq!(run.code, 0, "{}", run.err);
    let text = std::fs::read_to_string(output).unwrap();
    assert!(
        text.starts_with("east_m,north_m,up_m,time_s,intensity,Intensity_2,aaa\n"),
        "{text}"
    );
}

#[test]
fn intensities_that_las_rounds_are_named() {
    let (cloud, _) = assert_points(
        "float_intensity_las/if.csv",
        &[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]],
    );
    assert_eq!(cloud.intensity, [0.395, 0.554, 1.0]);
    let folder = tempfile::tempdir().unwrap();
    let input = case("float_intensity_las/if.csv");
    let (input, out) = (input.to_str().unwrap(), folder.path().to_str().unwrap());
    let output = folder.path().join("a.laz");
    for arguments in [
        &["convert", input, output.to_str().unwrap()][..],
        &["thin", input, "--voxel-m", "0.1", "--out", out],
    ] {
        let run = boresight(arguments);
        let expected = "2 of 3, which are 0.395 to 1 in all";
        assert!(run.err.contains(expected), "{}", run.err);
    }
}
