//! Build script: identifies the solver by a hash of the sources and libraries that determine its numerical results.
//! Results carry this identifier, so that a run can tell which of them an older solver computed.

use std::path::{Path, PathBuf};

/// Paths under `src/` that determine the numerical results of a job.
const SOURCES: [&str; 26] = [
    "analysis.rs",
    "curves",
    "deadline.rs",
    "entries.rs",
    "guess.rs",
    "mesh_error.rs",
    "methods",
    "model",
    "motion",
    "near_optimal.rs",
    "nlp",
    "numerics",
    "plausibility.rs",
    "prepare.rs",
    "problem",
    "recruited.rs",
    "recruitment",
    "settings",
    "skeleton",
    "solution",
    "solve.rs",
    "starts.rs",
    "study/change.rs",
    "transcription",
    "uniqueness.rs",
    "warm.rs",
];
/// Dependencies that determine the numerical results, with their versions in `Cargo.lock`.
const LIBRARIES: [&str; 8] = ["clarabel", "faer", "nalgebra", "num-dual", "pulp", "rand", "rand_chacha", "rand_distr"];

fn main() {
    let root = PathBuf::from(std::env::var("CARGO_MANIFEST_DIR").expect("cargo sets it"));
    let mut hash = Fnv::default();
    for source in SOURCES {
        let path = root.join("src").join(source);
        println!("cargo::rerun-if-changed={}", path.display());
        hash.add_files(&path);
    }
    let lock = root.join("Cargo.lock");
    println!("cargo::rerun-if-changed={}", lock.display());
    let lock = std::fs::read_to_string(lock).unwrap_or_default();
    let named = |part: &&str| LIBRARIES.iter().any(|name| part.contains(&format!("name = \"{name}\"\n")));
    lock.split("[[package]]").filter(named).for_each(|part| hash.add(part.as_bytes()));
    println!("cargo::rustc-env=SINEW_SOLVER={}+{:08x}", std::env::var("CARGO_PKG_VERSION").unwrap(), hash.0 as u32);
}

/// 64-bit FNV-1a (Fowler–Noll–Vo): sufficient to distinguish versions, without a dependency.
struct Fnv(u64);

impl Default for Fnv {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl Fnv {
    fn add(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }

    fn add_files(&mut self, path: &Path) {
        if path.is_dir() {
            let mut inner: Vec<PathBuf> = std::fs::read_dir(path).unwrap().map(|entry| entry.unwrap().path()).collect();
            inner.sort();
            inner.iter().for_each(|path| self.add_files(path));
        } else {
            self.add(&std::fs::read(path).unwrap());
        }
    }
}
