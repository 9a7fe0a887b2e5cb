# What can be done here; `just` lists it.

_list:
    @just --list

# All tests, as the continuous integration runs them
test:
    cargo test --release

# Three simulated drives, everything on them, and the report in out/
demo:
    cargo run --release -- demo

# The same at the paper's rates: gigabytes of profiles
full:
    cargo run --release -- simulate --scenario full --out out/full
    cargo run --release -- run out/full/drive-1/project.toml

# Formatting, clippy and documentation, with warnings denied
lint:
    cargo fmt --check
    cargo clippy --all-targets -- -D warnings
    RUSTDOCFLAGS=-Dwarnings cargo doc --no-deps

# Licences, advisories and sources of the dependencies (needs cargo-deny)
deny:
    cargo deny check

# The trajectory beside gtsam on the same logs; writes docs/performance.md (needs Python)
bench-trajectory *ARGS:
    python3 benches/trajectory/run.py {{ARGS}}

# Errors of the calibration against its sigmas over SEEDS simulated drives
montecarlo SEEDS="10":
    cargo run --release --example montecarlo -- {{SEEDS}}

# What an update of the online smoother costs through an hour
online:
    cargo test --release --test trajectory -- cost_is_flat --ignored --nocapture

# Errors of the poses and constants against their covariances over DRIVES simulated drives
consistency DRIVES="50":
    cargo run --release --example consistency -- {{DRIVES}}

# The kernels beside their peers on the same files; writes docs/performance.md (needs Python)
bench-kernels *ARGS:
    python3 benches/kernels/run.py {{ARGS}}

# Every message that a user can meet, for reading aloud (needs Python)
messages *FILES:
    python3 tools/messages.py {{FILES}}
