//! Code compiled for the vector units of the machine it runs on.
//!
//! Wider vectors change only how many numbers are computed at a time: Rust neither fuses
//! multiplications with additions nor reorders sums, so every machine computes the same bits.

/// Defines a function that runs another one, which must be `#[inline(always)]`, compiled for the
/// widest vectors available.
macro_rules! with_widest_vectors {
    ($(#[$doc:meta])* $vis:vis fn $name:ident $(<$($generic:ident: $bound:path),*>)? ($($arg:ident: $type:ty),* $(,)?) $(-> $result:ty)? = $body:path) => {
        $(#[$doc])*
        $vis fn $name $(<$($generic: $bound),*>)? ($($arg: $type),*) $(-> $result)? {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,bmi1,bmi2,lzcnt,popcnt")]
                fn with_avx512 $(<$($generic: $bound),*>)? ($($arg: $type),*) $(-> $result)? {
                    $body($($arg),*)
                }
                #[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
                fn with_avx2 $(<$($generic: $bound),*>)? ($($arg: $type),*) $(-> $result)? {
                    $body($($arg),*)
                }
                match $crate::cloud::vectors::Width::here() {
                    // SAFETY: the machine has the instructions that the function was compiled for.
                    #[allow(unsafe_code)]
                    $crate::cloud::vectors::Width::Avx512 => return unsafe { with_avx512($($arg),*) },
                    // SAFETY: as above.
                    #[allow(unsafe_code)]
                    $crate::cloud::vectors::Width::Avx2 => return unsafe { with_avx2($($arg),*) },
                    $crate::cloud::vectors::Width::Baseline => {}
                }
            }
            $body($($arg),*)
        }
    };
}

pub(crate) use with_widest_vectors;

/// The vector instructions that code is compiled for.
#[cfg(target_arch = "x86_64")]
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Width {
    /// 512 bits.
    Avx512,
    /// 256 bits.
    Avx2,
    /// Available on every machine.
    Baseline,
}

#[cfg(target_arch = "x86_64")]
impl Width {
    /// The widest of this machine; detected once, by the standard library.
    pub(crate) fn here() -> Self {
        let avx2 = is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("bmi1")
            && is_x86_feature_detected!("bmi2")
            && is_x86_feature_detected!("lzcnt")
            && is_x86_feature_detected!("popcnt");
        let avx512 = is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512bw")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512vl");
        if avx2 && avx512 {
            Self::Avx512
        } else if avx2 {
            Self::Avx2
        } else {
            Self::Baseline
        }
    }
}
