//! A policy for C: header, examples and the policy file as an array.

use std::fmt::Write;

const HEADER: &str = include_str!("../../controller/c/include/omniwalk.h");
const EXAMPLE_C: &str = include_str!("../../controller/c/examples/golden.c");
const EXAMPLE_CPP: &str = include_str!("../../controller/c/examples/golden.cpp");

/// The files for C of the policy file `bytes`: name and content.
pub fn files(bytes: &[u8]) -> [(&'static str, String); 5] {
    [
        ("omniwalk.h", HEADER.to_owned()),
        ("golden.c", EXAMPLE_C.to_owned()),
        ("golden.cpp", EXAMPLE_CPP.to_owned()),
        ("policy.h", POLICY_HEADER.to_owned()),
        ("policy.c", array(bytes)),
    ]
}

const POLICY_HEADER: &str = "\
/* A policy file as an array: ow_load(omniwalk_policy, omniwalk_policy_size, &controller). */
#ifndef OMNIWALK_POLICY_H
#define OMNIWALK_POLICY_H

#include <stddef.h>

#ifdef __cplusplus
extern \"C\" {
#endif

extern const unsigned char omniwalk_policy[];
extern const size_t omniwalk_policy_size;

#ifdef __cplusplus
}
#endif

#endif
";

fn array(bytes: &[u8]) -> String {
    let mut text = String::from("#include \"policy.h\"\n\nconst unsigned char omniwalk_policy[] = {\n");
    for line in bytes.chunks(20) {
        for byte in line {
            // Writing to a string does not fail.
            let _ = write!(text, "{byte},");
        }
        text.push('\n');
    }
    text += "};\n\nconst size_t omniwalk_policy_size = sizeof omniwalk_policy;\n";
    text
}
