//! What names tell of a stack before it is sent is what its zip tells.

use super::*;
use crate::archive::scan::group_names;

#[test]
fn names_tell_of_a_stack_what_its_zip_tells() {
    for names in [
        &["front/1.png", "front/2.png", "back/1.png", "back/2.png"][..],
        &["Käfer/vorne/s10.png", "Käfer/vorne/s9.png", "Käfer/Gegenlicht/a.png", "Käfer/Gegenlicht/b.png"],
        &["甲虫/b.png", "甲虫/a.png"],
        &["خنفساء/front/1.png", "خنفساء/front/2.png"],
        &["front/1.png", "front/2.png", "uv/1.png", "uv/2.png", "left/1.png", "left/2.png"],
        &["t/front/1.png", "t/front/2.png", "t/moved/near.png"],
        &["step_-00400_.png", "step_00000_.png", "step_-00800_.png"],
        &["IMG_9998.png", "IMG_9999.png", "IMG_0001.png"],
        // refused
        &["front/1.png"],
        &["back/1.png", "back/2.png"],
        &["front/1.png", "front/2.png", "front/3.png", "back/1.png", "back/2.png"],
        &["front/1.png", "front/2.png", "uv/1.png"],
        &["1.png", "front/2.png", "front/3.png"],
        &["pan000/1.png", "pan000/2.png", "pan020/1.png", "pan020/2.png"],
        &["front/a/1.png", "front/b/2.png"],
        &["front/1.png", "front/2.png", "fl 1/1.png", "fl 1/2.png"],
        &["1.png", "1.jpg", "2.png"],
    ] {
        let owned: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
        let named = group_names(&owned, None, &ScanRules::default()).unwrap().stack;
        match open_bytes(&zip(&pictures(names))) {
            Ok(archive) => {
                let layout = archive.layout();
                assert_eq!((named.front, named.back), (layout.front.clone(), layout.back.clone()), "{names:?}");
                assert_eq!((named.lights, named.moved), (layout.lights.clone(), layout.moved.clone()), "{names:?}");
                assert_eq!(named.problem, None, "{names:?}");
            }
            Err(error) => assert_eq!(named.problem, Some(error.detail), "{names:?}"),
        }
    }
}

#[test]
fn a_manifest_gives_the_order_and_gaps_are_named() {
    let of = |names: &[&str], listed: Option<&[u8]>| {
        let names: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
        group_names(&names, listed, &ScanRules::default()).unwrap()
    };
    let listed = of(&["a.png", "b.png", "manifest.json"], Some(br#"{"front": ["b.png", "a.png"]}"#)).stack;
    assert_eq!((listed.front, listed.problem), (vec!["b.png".to_owned(), "a.png".to_owned()], None));
    let gap = of(&["s1.png", "s2.png", "s4.png", "s5.png"], None);
    let words = Some("after s2.png comes s4.png".to_owned());
    assert_eq!((gap.stack.gaps, gap.views[0].gaps.clone()), (words.clone(), words));
}
