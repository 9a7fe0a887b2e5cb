# Recipes; `just` lists them.

_list:
    @just --list

# All tests, as the continuous integration runs them
test:
    cargo test

# The long tests that `test` leaves out, all of them or those with PART in their name: docs/acceptance.md
acceptance PART="":
    cargo test --release --test it --test clock -- --ignored --nocapture --test-threads=1 --skip geocompy --skip sbgecom {{replace(PART, "-", "_")}}

# Simulates three drives and runs everything on them; the report is in out/
demo:
    cargo run --release -- demo

# The same at the paper's rates: gigabytes of profiles
full:
    cargo run --release -- simulate --scenario full --out out/full
    cargo run --release -- run out/full/drive-1/project.toml

# Builds the viewer of the report's clouds, web/dist/viewer.js (needs node and npm)
web:
    cd web && npm ci --no-fund --no-audit && npm run --silent build

# Checks that the committed viewer is up to date and works in a browser (needs node, npm and Chromium)
web-test:
    cargo build --release
    cd web && npm ci --no-fund --no-audit && npm run --silent test

# Frame times of the viewer with software rendering, at 200,000 and 1,000,000 points
web-frames:
    cd web && npm run --silent frames

# Formatting, clippy and documentation, with warnings denied
lint:
    cargo fmt --check
    cargo clippy --workspace --all-targets --features boresight/examples -- -D warnings
    cargo clippy --no-default-features -p boresight-cloud -p boresight-format -- -D warnings
    RUSTDOCFLAGS=-Dwarnings cargo doc --workspace --no-deps

# Compiles with the oldest Rust that the README names, before a release or after a change of dependencies
oldest:
    rustup toolchain install 1.89 --profile minimal
    CARGO_TARGET_DIR=target/oldest rustup run 1.89 cargo check --locked

# Licences, advisories and sources of the dependencies (needs cargo-deny and the network; `.ci/run` does without)
deny:
    cargo deny check

# Builds the Python package into a new environment and tests it (needs Python, pip and the network)
python:
    tools/python.sh

# Overhead of Python compared with the command, on 5 million points (needs the package installed)
bench-python *ARGS:
    python3 python/benches/overhead.py --command target/release/boresight {{ARGS}}

# A campaign of 200 items on Dask: killed processes, failures, S3, scaling (needs the package with its group `test`)
campaign-dask *ARGS:
    python3 python/benches/campaign.py {{ARGS}}

# Benchmark of the trajectory against gtsam on the same logs; writes docs/performance.md (needs Python)
bench-trajectory *ARGS:
    python3 benches/trajectory/run.py {{ARGS}}

# Errors of the calibration compared with its sigmas over SEEDS simulated drives
montecarlo SEEDS="10":
    cargo run --release --features examples --example montecarlo -- {{SEEDS}}

# Errors of the joint adjustment compared with two steps over SEEDS simulated drives: the tables of docs/joint.md
joint SEEDS="30" FIRST="1" *ARGS:
    cargo run --release --features examples --example joint -- {{SEEDS}} {{FIRST}} {{ARGS}}

# Runs SEEDS drives that are drawn at random and compares results with the truth; the figure of ranks is in out/random.
# With `tiny` as SIZE, short drives; with `"tiny faulty"` or `faulty`, each has a fault that its project does not state
random SEEDS="20" FIRST="1" SIZE="":
    cargo run --release --features examples --example random -- {{SEEDS}} {{FIRST}} {{SIZE}}

# Simulated campaigns of 20 days with a knock on day 7: the tables of docs/drift.md
drift SEEDS="3" FIRST="1" *ARGS:
    cargo run --release --features examples --example drift -- {{SEEDS}} {{FIRST}} {{ARGS}}

# How far from the minimum the calibration still converges to it: STARTS random starts at each distance
basin STARTS="100" DRIVE="":
    cargo run --release --features examples --example basin -- {{STARTS}} {{DRIVE}}

# Tests the GeoCOM client and the simulated instrument against geocompy (needs a PYTHON with geocompy and pyserial)
geocompy PYTHON:
    cargo build --release --features examples --example geocom_simulated --example geocom_track
    BORESIGHT_GEOCOMPY={{PYTHON}} cargo test --release --features examples --test it geocompy -- --ignored --nocapture

# Tests recording and reading of sbgECom against the manufacturer's library in PREFIX (needs a C compiler)
sbgecom PREFIX:
    BORESIGHT_SBGECOM={{PREFIX}} cargo test --release --test clock sbgecom -- --ignored --nocapture --test-threads=1

# Errors of the poses and constants compared with their covariances over DRIVES simulated drives
consistency DRIVES="50":
    cargo run --release --features examples --example consistency -- {{DRIVES}}

# Benchmark of the kernels against their peers on the same files; writes docs/performance.md (needs Python)
bench-kernels *ARGS:
    python3 benches/kernels/run.py {{ARGS}}

# Benchmark of moving mountings against KinScanCal on the same drives (needs Python; three quarters of an hour)
bench-moving *ARGS:
    python3 benches/moving/run.py {{ARGS}}

# Speed of reading a recording on one core, compared with reading only its bytes
read-speed *FILE:
    cargo run --release --features examples --example read_speed -- {{FILE}}

# Fuzzes every reader for SECONDS each and counts the executions (needs cargo-fuzz, g++ and Python)
fuzz SECONDS="60" *TARGETS:
    python3 tools/fuzz.py {{SECONDS}} {{TARGETS}}

# All messages that users can see, for proofreading (needs Python)
messages *FILES:
    python3 tools/messages.py {{FILES}}

# The book, in target/book (needs mdBook: `cargo install --locked mdbook --version 0.5.4`)
book:
    mdbook build

# The tables of docs/project.md, made from the code
keys:
    BORESIGHT_WRITE=1 cargo test -p boresight-project -p boresight --lib project::tests::keys
    cargo test -p boresight-project -p boresight --lib project::tests::keys

# Predicted standard deviations of the layouts of docs/field.md (some minutes each)
field *NAMES:
    cargo build --release
    python3 tools/field.py --write {{NAMES}}

# The pictures of README and book, from the demo and from a drive whose frame bends (needs node, npm and Chromium)
pictures:
    cargo run --release -- demo
    cargo run --release -- simulate --scenario web/moving.toml --out out/moving --force
    cargo run --release -- run out/moving/drive-1
    cd web && npm ci --no-fund --no-audit && node pictures.js ../out ../out/moving/drive-1/out
