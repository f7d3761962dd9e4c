//! What is fixed to a chain belongs to it, wherever its base is named, and no shape of it is lost.

use crate::arm::{Chain, Payload};

const BALL: &str = "<collision><geometry><sphere radius=\"0.1\"/></geometry></collision>";

fn link(name: &str, inside: &str) -> String {
    format!("<link name=\"{name}\">{inside}</link>\n")
}

fn joint(kind: &str, [parent, child]: [&str; 2], origin: &str) -> String {
    let moves = "<axis xyz=\"0 0 1\"/><limit lower=\"-1\" upper=\"1\" velocity=\"1\" effort=\"10\"/>";
    format!(
        "<joint name=\"to_{child}\" type=\"{kind}\"><parent link=\"{parent}\"/><child link=\"{child}\"/><origin \
         {origin}/>{moves}</joint>\n"
    )
}

fn fixed(ends: [&str; 2], origin: &str) -> String {
    joint("fixed", ends, origin)
}

/// `world` below everything, `foot` and `base` as ROS's arms have them, a post beside `foot`, a shelf on
/// `world`, two joints, and `more` from line 17.
fn arm(more: &str) -> String {
    let turned = "rpy=\"0 0 3.141592653589793\"";
    [
        "<robot>\n".to_owned(),
        ["world", "foot", "inner", "base", "l1", "l2"].map(|name| link(name, "")).concat(),
        link("post", BALL) + &link("shelf", BALL),
        fixed(["world", "foot"], "xyz=\"0 0 0.3\" rpy=\"0 0 0.5\""),
        fixed(["foot", "inner"], turned) + &fixed(["foot", "base"], turned),
        fixed(["foot", "post"], "xyz=\"0.4 0.1 0.45\"")
            + &fixed(["world", "shelf"], "xyz=\"1 0 2\" rpy=\"0.2 0 0\""),
        joint("revolute", ["inner", "l1"], "xyz=\"0 0 0.1\""),
        joint("revolute", ["l1", "l2"], "xyz=\"0 0 0.4\" rpy=\"1 0 0\""),
        format!("{more}</robot>"),
    ]
    .concat()
}

fn chain(text: &str, base: &str) -> Result<Chain<2>, String> {
    Chain::from_urdf(text, Some(base), Some("l2")).map_err(|error| error.to_string())
}

/// Every link that does not move against the arm's foot can be the base, and the arm has the same shapes at
/// the same places, seen from its tool.
#[test]
fn whichever_fixed_link_is_the_base_the_arm_and_its_keep_outs_are_the_same() {
    let text = arm("");
    let seen = |base: &str| {
        let chain = chain(&text, base).unwrap_or_else(|why| panic!("{base}: {why}"));
        let at = chain.forward(&[0.3, -0.4]);
        let mut shapes: Vec<_> = chain
            .capsules()
            .iter()
            .map(|body| {
                assert_eq!(body.link, 0);
                let from = at.rotation.tr_mul(&(at.axis(body).from - at.position));
                (body.name.clone(), from.map(|x| (x * 1e9).round()))
            })
            .collect();
        shapes.sort_by(|a, b| a.0.cmp(&b.0));
        shapes
    };
    let wanted = seen("world");
    assert_eq!(wanted.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["post", "shelf"]);
    for base in ["foot", "inner", "base", "post", "shelf"] {
        assert_eq!(seen(base), wanted, "{base}");
    }
    // What is said of the frames: all of them, and which hang below the base.
    let chain = chain(&text, "foot").unwrap();
    let still: Vec<_> = chain.still_links().iter().map(|link| (link.name.as_str(), link.below)).collect();
    let wanted =
        [("foot", true), ("world", false), ("inner", true), ("base", true), ("post", true), ("shelf", false)];
    assert_eq!(still, wanted);
}

#[test]
fn what_hangs_behind_a_moving_joint_below_the_base_is_not_fixed_to_it() {
    let cart = link("cart", BALL) + &joint("prismatic", ["cart", "world"], "xyz=\"0 0 0\"");
    assert_eq!(chain(&arm(&cart), "foot").unwrap().capsules().len(), 2);
    let finger = link("finger", BALL) + &joint("prismatic", ["l2", "finger"], "xyz=\"0 0 0\"");
    assert_eq!(chain(&arm(&finger), "foot").unwrap().capsules().len(), 2);
}

#[test]
fn a_joint_that_names_a_link_that_is_not_there_is_refused_where_a_shape_could_be_lost() {
    let says = |text: &str, words: &[&str]| {
        let why = chain(text, "foot").unwrap_err();
        assert!(words.iter().all(|word| why.contains(word)), "{words:?}: {why}");
    };
    let whole = arm("");
    // On the way to the tool: a capital, a space, an element with a prefix, one with a capital, no name.
    for (from, to) in [
        ("<link name=\"l1\">", "<link name=\"L1\">"),
        ("<link name=\"l1\">", "<link name=\"l1 \">"),
        ("<link name=\"l1\"></link>", "<u:link name=\"l1\"></u:link>"),
        ("<link name=\"l1\"></link>", "<Link name=\"l1\"></Link>"),
        ("<link name=\"l1\">", "<link>"),
    ] {
        assert!(whole.contains(from));
        says(&whole.replacen(from, to, 1), &["joint `to_l2` (line 16) names link `l1`, which is not there"]);
    }
    says(&whole.replacen("<link name=\"l1\">", "<link>", 1), &["the link in line 6", "has no name"]);
    // Fixed joints at the chain, by either end; and one that may be at it, with something to lose.
    let shown = link("eye", BALL);
    for more in [
        shown.clone() + &fixed(["l2", "Eye"], "xyz=\"0 0 0\""),
        shown.clone() + &fixed(["nowhere", "world"], "xyz=\"0 0 0\""),
        shown.clone() + &fixed(["L2", "eye"], "xyz=\"0 0 0\""),
        shown.clone() + &fixed(["L2", "Eye"], "xyz=\"0 0 0\""),
        link("eye", "") + &link("lid", BALL) + &fixed(["L2", "eye"], "") + &fixed(["eye", "lid"], ""),
        link("eye", "<inertial><mass value=\"1\"/><inertia/></inertial>") + &fixed(["L2", "eye"], ""),
    ] {
        says(&arm(&more), &["which is not there"]);
    }
    // Without a parent, with two, or of a type that nobody knows.
    let whole = fixed(["l2", "eye"], "xyz=\"0 0 0\"");
    for (from, to, words) in [
        ("<parent link=\"l2\"/>", "", "has no <parent"),
        ("<parent link=\"l2\"/>", "<parent link=\"l2\"/><parent link=\"world\"/>", "a second <parent>"),
        ("<child link=\"eye\"/>", "<child link=\"eye\"/><child link=\"l1\"/>", "a second <child>"),
        ("<child link=\"eye\"/>", "<child link=\"&nbsp;\"/>", "<child link>"),
        ("type=\"fixed\"", "type=\"Fixed\"", "Fixed"),
        ("type=\"fixed\"", "", "type"),
        ("xyz=\"0 0 0\"", "xyz=\"0 0\"", "expected 3"),
    ] {
        assert!(whole.contains(from));
        let text = arm(&(shown.clone() + &whole.replacen(from, to, 1)));
        says(&text, &["joint `to_eye` (line 18)", "cannot be read", words]);
    }
    says(&arm(&(shown.clone() + &whole + &whole)), &["link `eye` (line 17)", "more than one joint"]);
    // With nothing to lose none of it matters.
    for joint in [
        fixed(["L2", "eye"], ""),
        whole.replacen("<parent link=\"l2\"/>", "", 1),
        whole.replacen("type=\"fixed\"", "type=\"Fixed\"", 1),
        whole.replacen("xyz=\"0 0 0\"", "xyz=\"0 0\"", 1),
        whole.replacen("name=\"to_eye\"", "", 1),
        joint("prismatic", ["L2", "eye"], "xyz=\"a\""),
    ] {
        let found =
            chain(&arm(&(link("eye", "") + &joint)), "foot").unwrap_or_else(|why| panic!("{joint}: {why}"));
        assert_eq!(found.capsules().len(), 2);
    }
}

#[test]
fn a_mass_whose_place_is_not_known_leaves_the_torques_unknown() {
    let mass = "<inertial><mass value=\"1\"/><inertia ixx=\"1\" ixy=\"0\" ixz=\"0\" iyy=\"1\" iyz=\"0\" izz=\"1\"/></inertial>";
    let heavy = arm("").replace("<link name=\"l1\">", &format!("<link name=\"l1\">{mass}"));
    let heavy = heavy.replace("<link name=\"l2\">", &format!("<link name=\"l2\">{mass}"));
    let torques = |more: &str| {
        let text = heavy.replace("</robot>", &format!("{more}</robot>"));
        chain(&text, "foot").unwrap().dynamics(&Payload::NONE).map(|_| ()).map_err(|why| why.to_string())
    };
    assert_eq!(torques(""), Ok(()));
    let place = fixed(["l2", "eye"], "xyz=\"0 0\"");
    assert_eq!(torques(&(link("eye", "") + &place)), Ok(()));
    let why = torques(&(link("eye", mass) + &place)).unwrap_err();
    assert!(why.contains("link `eye` (line 17)") && why.contains("where it stands is not known"), "{why}");
    // An effort of 0 is one that nobody stated: KUKA, FANUC and ABB packages have it.
    for effort in ["effort=\"0\"", ""] {
        let text =
            heavy.replacen("effort=\"10\"/></joint>\n</robot>", &format!("{effort}/></joint>\n</robot>"), 1);
        assert_ne!(text, heavy);
        let why = chain(&text, "foot").unwrap().dynamics(&Payload::NONE).unwrap_err().to_string();
        assert!(why.contains("effort limit of joint `to_l2` is 0 or missing"), "{why}");
    }
}

#[test]
fn two_joints_of_one_name_on_the_way_to_the_tool_are_refused() {
    let why = chain(&arm("").replace("name=\"to_l2\"", "name=\"to_l1\""), "foot").unwrap_err();
    assert!(why.contains("joint `to_l1` (line 15) stands there again in line 16"), "{why}");
    let beside = link("eye", "") + &joint("prismatic", ["l2", "eye"], "");
    assert!(chain(&arm(&beside.replace("to_eye", "to_l1")), "foot").is_ok());
}

#[test]
fn a_size_below_zero_is_refused() {
    for shape in [
        "<box size=\"-1 0.1 0.1\"/>",
        "<box size=\"0.1 -0.1 1\"/>",
        "<cylinder radius=\"0.1\" length=\"-1\"/>",
        "<capsule radius=\"0.1\" length=\"-1\"/>",
        "<sphere radius=\"-0.1\"/>",
        "<box size=\"nan 1 1\"/>",
    ] {
        let eye = link("eye", &format!("<collision><geometry>{shape}</geometry></collision>"));
        let why = chain(&arm(&(eye + &fixed(["l2", "eye"], "xyz=\"0 0 0\""))), "foot").unwrap_err();
        assert!(why.contains("link `eye` (line 17)") && why.contains("not positive"), "{shape}: {why}");
    }
}
