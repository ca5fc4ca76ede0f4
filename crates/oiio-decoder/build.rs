//! Compiles the shim against the system's OpenImageIO (Debian and Ubuntu: `libopenimageio-dev`).
fn main() {
    println!("cargo::rerun-if-changed=src/shim.cpp");
    cc::Build::new()
        .cpp(true)
        .std("c++17")
        .file("src/shim.cpp")
        .compile("oiio_shim");
    println!("cargo::rustc-link-lib=OpenImageIO");
    println!("cargo::rustc-link-lib=OpenImageIO_Util");
}
