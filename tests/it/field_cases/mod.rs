//! Files as people have them, made after reports about other programs: one test for each folder of
//! `tests/data/field_cases`.

mod clouds;
