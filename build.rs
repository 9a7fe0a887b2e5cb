//! Tells the tests what is at hand, so that those that need more are listed as ignored.

fn main() {
    println!("cargo::rustc-check-cfg=cfg(has_data, has_avx512)");
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=BORESIGHT_DATA");
    if std::env::var_os("BORESIGHT_DATA").is_some_and(|folder| !folder.is_empty()) {
        println!("cargo::rustc-cfg=has_data");
    }
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512bw")
        && is_x86_feature_detected!("avx512dq")
        && is_x86_feature_detected!("avx512vl")
    {
        println!("cargo::rustc-cfg=has_avx512");
    }
}
