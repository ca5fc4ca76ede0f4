//! Loops over pixels compiled more than once, for the vectors that a processor may have, and chosen at run time.

use std::sync::LazyLock;

/// What this processor can do.
pub static ARCH: LazyLock<pulp::Arch> = LazyLock::new(pulp::Arch::new);

/// Defines functions whose bodies run with the widest vectors of this processor. What they call in a loop must be
/// `#[inline(always)]`, and no closure of any size: everything else is compiled once, for any processor. Results do not
/// depend on the vectors: nothing is reordered, and a `mul_add` is exact on every processor (and slow on one that has none).
macro_rules! vectorised {
    ($($(#[$meta:meta])* $vis:vis fn $name:ident<$life:lifetime>($($arg:ident: $type:ty),* $(,)?) $(-> $output:ty)? $body:block)*) => {$(
        $(#[$meta])*
        $vis fn $name<$life>($($arg: $type),*) $(-> $output)? {
            struct Call<$life> {
                $($arg: $type),*
            }
            impl<$life> pulp::NullaryFnOnce for Call<$life> {
                type Output = $crate::metrics::vector::output!($($output)?);

                #[inline(always)]
                fn call(self) -> Self::Output {
                    let Self { $($arg),* } = self;
                    $body
                }
            }
            $crate::metrics::vector::ARCH.dispatch(Call { $($arg),* })
        }
    )*};
}

macro_rules! output {
    () => {
        ()
    };
    ($output:ty) => {
        $output
    };
}

pub(super) use {output, vectorised};
