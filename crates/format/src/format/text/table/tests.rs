use super::*;

const COLUMNS: Columns = Columns {
    needed: &["time_s", "x_m"],
    optional: &["sigma_m"],
};

fn rows(text: &str) -> Result<Vec<[f64; 3]>> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.csv");
    std::fs::write(&path, text).unwrap();
    let mut table = Table::open(&Input::from(&path), &COLUMNS)?;
    let mut rows = Vec::new();
    let mut row = [0.0; 3];
    while table.next_row(&mut row)? {
        rows.push(row);
    }
    Ok(rows)
}

fn message(text: &str) -> String {
    rows(text).unwrap_err().to_string()
}

#[test]
fn separators_order_comments_and_line_ends_do_not_matter() {
    for text in [
        "time_s,x_m,sigma_m\n1,2,3\n",
        "\u{feff}# made by hand\r\n\r\n x_m ; sigma_m;time_s\r\n2;3; 1\r\n",
        "x_m\ttime_s  other sigma_m\n# half way\n2 1 red 3",
        "# time_s, x_m, sigma_m\n1, 2, 3\n",
        "\"time_s\",\"x_m\",\"sigma_m\"\n1e0,+2.0,3\n\n",
        "time_s\tx_m\tother\tsigma_m\n1\t2\t\t3\n",
        "time_s\tx_m\tsigma_m\n1\t\t2\t\t3\n",
    ] {
        assert_eq!(rows(text).unwrap(), [[1.0, 2.0, 3.0]], "{text}");
    }
    assert!(rows("time_s,x_m\n1,2").unwrap()[0][2].is_nan());
    for text in [
        "time_s,x_m,sigma_m\n1,2,\n",
        "time_s\tx_m\tsigma_m\n1\t2\t\n",
    ] {
        assert!(rows(text).unwrap()[0][2].is_nan(), "{text}");
    }
}

#[test]
fn rows_without_a_value_are_left_out() {
    for cell in ["NaN", "", "1.#QNAN", "-", "n/a"] {
        let found = rows(&format!("time_s,x_m\n1,2\n2,{cell}\n3,4\n")).unwrap();
        assert_eq!([found[0][1], found[1][1]], [2.0, 4.0], "{cell}");
    }
}

#[test]
fn times_may_be_dates_and_their_column_may_have_no_unit() {
    let found = rows("Time;x_m;sigma_m\n2023-11-14T22:13:20.5Z;2;3\n").unwrap();
    assert_eq!(found, [[1_700_000_000.5, 2.0, 3.0]]);
    assert_eq!(
        rows("time,time_s,x_m,sigma_m\n9,1,2,3\n").unwrap()[0][0],
        1.0
    );
}

#[test]
fn units_below_the_header_are_passed_over() {
    let found = rows("time_s;x_mm;other\n[s];mm;text\n1;2000;3\n").unwrap();
    assert_eq!(found[0][..2], [1.0, 2.0]);
    // Those that contradict the names are not.
    assert!(message("time_s,x_m\ns,mm\n1,2\n").contains("line 2: found `s` in column time_s"));
}

#[test]
fn other_units_are_converted() {
    let found = rows("time_ms,x_mm,sigma_cm\n1500,250,2\n").unwrap();
    assert_eq!(found, [[1.5, 0.25, 0.02]]);
}

#[test]
fn errors_name_line_finding_and_expectation() {
    let text = message("time_s,x_me\n1,2\n");
    assert!(
        text.contains("line 1") && text.contains("`x_me` looks like `x_m`"),
        "{text}"
    );
    let text = message("time_s,x_m,sgma_m\n1,2,3\n");
    assert!(text.contains("`sgma_m` looks like `sigma_m`"), "{text}");
    let text = message("time_s,x_m\n1,2\n3,NaN\n");
    assert!(
        text.contains("line 3") && text.contains("`NaN` in column x_m"),
        "{text}"
    );
    let text = message("time_s,x_m\n1,\n");
    assert!(text.contains("`` in column x_m"), "{text}");
    let text = message("time_s,x_m\n# c\n1,2,3\n");
    assert!(
        text.contains("line 3: found 3 values, expected 2"),
        "{text}"
    );
    let text = message("1,2\n");
    assert!(text.contains("2 numbers without a header"), "{text}");
    let text = message("time_s,x_m,x_m\n1,2,2\n");
    assert!(text.contains("column x_m twice"), "{text}");
    let text = message("time_s,x_m,x_mm\n1,2,2\n");
    assert!(text.contains("column x_m twice"), "{text}");
    let text = message("time_s,x_km\n1,1e307\n");
    assert!(text.contains("`1e307` in column x_km"), "{text}");
    let text = message(&format!("time_s,x_m{}\n", ",a".repeat(MOST_COLUMNS)));
    assert!(
        text.contains("line 1: found more than 1024 columns"),
        "{text}"
    );
    assert!(message("# nothing\n").contains("no header"));
    assert!(message("time_s\0,x_m\n").contains("zero bytes"));
}
