//! InkML files made here: contexts, encodings, groups and views, and everything that is refused.

use foretrace_sim::data::{Quantity, Recording, load_recording};

fn load(text: &[u8]) -> Result<Recording, String> {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.inkml");
    std::fs::write(&file, text).unwrap();
    let folder = format!("{}/", folder.path().display());
    load_recording(&file).map_err(|error| error.to_string().replace(&folder, ""))
}

fn good(text: &str) -> Recording {
    load(text.as_bytes()).unwrap()
}

/// Labels with the number of components and the first point of each.
fn inked(recording: &Recording) -> Vec<(&str, Vec<[f64; 2]>)> {
    let of = |c: &foretrace_sim::data::Character| c.components.iter().map(|c| c.points[0]).collect();
    recording.segments.iter().map(|c| (c.label.as_str(), of(c))).collect()
}

#[test]
fn the_plainest_file_is_one_character_with_y_turned_upwards() {
    let r = good("<ink><trace>10 0, 9 14</trace><trace type=\"penUp\">8 28</trace></ink>");
    assert_eq!(
        (r.rate_hz, r.rate_assumed, r.units_per_m, r.quantity),
        (100.0, true, None, Quantity::Position)
    );
    let [character] = &r.segments[..] else { panic!("{:?}", r.segments) };
    assert_eq!(character.components[0].points, [[10.0, -0.0], [9.0, -14.0]]);
    assert!(character.components[0].contact && !character.components[1].contact);
}

#[test]
fn contexts_give_units_rate_orientation_and_columns() {
    let r = good(
        r##"<?xml version="1.0"?>
<inkml:ink xmlns:inkml="http://www.w3.org/2003/InkML">
  <inkml:annotation type="writer">anna</inkml:annotation>
  <inkml:definitions>
    <inkml:inkSource xml:id="pad">
      <inkml:sampleRate uniform="true" value="133"/>
      <inkml:traceFormat>
        <inkml:channel name="F" type="integer"/>
        <inkml:channel name="Y" type="integer" orientation="-ve"/>
        <inkml:channel name="X" type="integer" units="mm"/>
        <inkml:intermittentChannels><inkml:channel name="B" type="boolean"/></inkml:intermittentChannels>
      </inkml:traceFormat>
      <inkml:channelProperties>
        <inkml:channelProperty channel="Y" name="resolution" value="2540" units="1/in"/>
      </inkml:channelProperties>
    </inkml:inkSource>
    <inkml:context xml:id="c" inkSourceRef="#pad"/>
    <inkml:brush xml:id="b"><inkml:annotation type="truth">not this</inkml:annotation></inkml:brush>
  </inkml:definitions>
  <inkml:trace contextRef="#c" brushRef="#b">5 2 1,5 '3 '4 T</inkml:trace>
</inkml:ink>"##,
    );
    assert_eq!((r.rate_hz, r.rate_assumed), (133.0, false));
    let [x, y] = r.units_per_m.unwrap();
    assert!((x - 1e3).abs() < 1e-9 && (y - 1e5).abs() < 1e-6, "{x} {y}");
    assert_eq!(r.segments[0].components[0].points, [[1.0, 2.0], [5.0, 5.0]]);
    assert_eq!((r.segments[0].writer.as_str(), r.segments[0].label.as_str()), ("anna", ""));
}

#[test]
fn groups_are_characters_and_the_nearest_label_counts() {
    let r = good(
        r#"<ink><annotation type="truth">whole</annotation>
<traceGroup><annotation type="truth">word</annotation>
  <traceGroup><annotation type="truth">a</annotation><annotation type="writer">w1</annotation>
    <trace>1 1</trace><traceGroup><trace>2 2</trace></traceGroup></traceGroup>
  <traceGroup><annotation>&quot;&#38;</annotation><trace>3 3</trace></traceGroup>
</traceGroup>
<traceGroup><trace>4 4</trace></traceGroup>
<trace>9 9</trace></ink>"#,
    );
    // The unlabelled group below "a" belongs to it; the trace outside all groups is left out.
    assert_eq!(
        inked(&r),
        [("a", vec![[1.0, -1.0], [2.0, -2.0]]), ("\"&", vec![[3.0, -3.0]]), ("", vec![[4.0, -4.0]])]
    );
    assert_eq!(r.segments[0].writer, "w1");
    let [outside] = &r.remarks[..] else { panic!("{:?}", r.remarks) };
    assert!(outside.count == 1 && outside.what.contains("outside every group"), "{outside}");
}

#[test]
fn views_label_traces_as_groups_do() {
    let r = good(
        r##"<ink><trace id="0">1 1</trace><trace id="1">2 2</trace><trace xml:id="2">3 3</trace>
<traceGroup xml:id="A"><annotation type="truth">From ITF</annotation>
  <traceGroup><annotation type="truth">x</annotation><traceView traceDataRef="1"/><traceView traceDataRef="#2"/>
    <annotationXML href="x_1"><annotation type="truth">no</annotation></annotationXML></traceGroup>
  <traceGroup><annotation type="truth">y</annotation><traceView traceDataRef="0"></traceView></traceGroup>
</traceGroup></ink>"##,
    );
    assert_eq!(inked(&r), [("x", vec![[2.0, -2.0], [3.0, -3.0]]), ("y", vec![[1.0, -1.0]])]);
    assert_eq!(r.remarks, []);
    let whole = good(
        r##"<ink><traceGroup xml:id="g"><trace>1 1</trace><traceGroup><trace>2 2</trace></traceGroup></traceGroup>
<traceView><annotation type="truth">k</annotation><traceView traceDataRef="#g"/></traceView></ink>"##,
    );
    assert_eq!(inked(&whole), [("k", vec![[1.0, -1.0], [2.0, -2.0]])]);
}

#[test]
fn stamps_give_the_rate_and_the_gaps() {
    let format = |unit: &str| {
        format!(
            "<traceFormat><channel name=\"X\"/><channel name=\"Y\"/><channel name=\"T\"{unit}/></traceFormat>"
        )
    };
    let body = "<trace>0 0 0,1 0 5,2 0 10,3 0 15,4 0 60</trace><trace>5 0 100</trace><trace>6 0 105</trace>";
    for (unit, factor) in [("", 1.0), (" units=\"s\"", 1e-3)] {
        let r = good(&format!("<ink>{}{body}</ink>", format(unit)));
        assert!((r.rate_hz - 200.0 * factor).abs() < 1e-9 && !r.rate_assumed, "{}", r.rate_hz);
        let gaps: Vec<Option<f64>> = r.segments[0].components.iter().map(|c| c.dt_before_s).collect();
        let wanted = [None, Some(0.045 / factor), Some(0.04 / factor), None];
        assert_eq!(gaps.len(), wanted.len(), "{gaps:?}");
        for (gap, wanted) in gaps.iter().zip(wanted) {
            assert!((gap.unwrap_or(-1.0) - wanted.unwrap_or(-1.0)).abs() < 1e-9, "{gaps:?}");
        }
    }
}

const XYT: &str =
    "<traceFormat><channel name=\"X\"/><channel name=\"Y\"/><channel name=\"T\"/></traceFormat>";

#[test]
fn uneven_stamps_stay_with_their_points_and_a_gap_in_a_trace_is_no_lift() {
    let r = good(&format!(
        "<ink>{XYT}<trace>0 0 1000,1 0 1008,4 0 1032,5 0 1040,8 0 1064,8 0 1400,9 0 1408</trace></ink>"
    ));
    assert!((r.rate_hz - 5.0 / 0.072).abs() < 0.01 && !r.rate_assumed, "{}", r.rate_hz);
    let [first, second] = &r.segments[0].components[..] else { panic!("{:?}", r.segments) };
    let steps: Vec<f64> = first.stamps_s.windows(2).map(|w| ((w[1] - w[0]) * 1e3).round()).collect();
    assert_eq!(steps, [8.0, 24.0, 8.0, 24.0]);
    assert!(second.continues && second.dt_before_s.is_some_and(|gap_s| (gap_s - 0.336).abs() < 1e-9));
    // At a constant speed even points are in line, whatever the stamps.
    let even = first.even_points(r.rate_hz);
    assert!(even.windows(2).all(|w| (w[1][0] - w[0][0] - 125.0 / r.rate_hz).abs() < 1e-6), "{even:?}");
    assert_eq!(r.remarks, []);
}

#[test]
fn equal_stamps_are_merged_and_steps_back_left_out_of_a_trace() {
    let r = good(&format!("<ink>{XYT}<trace>0 0 0,1 0 5,2 0 5,9 0 3,3 0 10,4 0 15</trace></ink>"));
    assert_eq!(r.segments[0].components[0].points, [[0.0, -0.0], [1.5, -0.0], [3.0, -0.0], [4.0, -0.0]]);
    let told: Vec<u64> = r.remarks.iter().map(|remark| remark.count).collect();
    assert_eq!((told, r.rate_hz.round()), (vec![1, 1], 200.0));
    let message = load(format!("<ink>{XYT}<trace>0 0 9,1 0 5,2 0 4</trace></ink>").as_bytes()).unwrap_err();
    assert!(message.starts_with("a.inkml: 2 of 3 stamps step back"), "{message}");
}

/// Traces with these times each, in the unit that `channel` states, along a line.
fn timed(channel: &str, traces: &[&[&str]]) -> String {
    let trace = |times: &&[&str]| {
        let points: Vec<String> = times.iter().enumerate().map(|(k, t)| format!("{k} 0 {t}")).collect();
        format!("<trace>{}</trace>", points.join(","))
    };
    let traces: String = traces.iter().map(trace).collect();
    format!(
        "<ink>{}{traces}</ink>",
        XYT.replace("<channel name=\"T\"/>", &format!("<channel name=\"T\"{channel}/>"))
    )
}

#[test]
fn even_stamps_give_their_rate_and_gaps_to_the_last_bit() {
    let ms = |t: f64| t * 1e-3;
    let (first, second) = (["0.000", "5.000", "10.000", "15.000", "20.000"], ["135.000", "140.000"]);
    let epoch = |times: &[&str]| -> Vec<String> {
        times.iter().map(|t| format!("1700000000{:03}", t.parse::<f64>().unwrap())).collect()
    };
    let (first_epoch, second_epoch) = (epoch(&first), epoch(&second));
    let words = |times: &'_ [String]| -> Vec<String> { times.to_vec() };
    for (channel, times, rate_hz, gap_s) in [
        (
            "",
            [first.map(str::to_owned).to_vec(), second.map(str::to_owned).to_vec()],
            200.0,
            ms(135.0) - ms(20.0),
        ),
        (
            " units=\"ms\"",
            [words(&first_epoch), words(&second_epoch)],
            200.0,
            ms(1_700_000_000_135.0) - ms(1_700_000_000_020.0),
        ),
        (
            " units=\"s\"",
            [["1.5", "1.5625", "1.625"].map(str::to_owned).to_vec(), vec!["3".to_owned()]],
            16.0,
            3.0 - 1.625,
        ),
    ] {
        let times: Vec<Vec<&str>> = times.iter().map(|t| t.iter().map(String::as_str).collect()).collect();
        let traces: Vec<&[&str]> = times.iter().map(Vec::as_slice).collect();
        let r = good(&timed(channel, &traces));
        let [one, two] = &r.segments[0].components[..] else { panic!("{r:?}") };
        assert_eq!((r.rate_hz, two.dt_before_s, &r.remarks[..]), (rate_hz, Some(gap_s), &[][..]));
        assert!(one.stamps_s.is_empty() && two.stamps_s.is_empty(), "{r:?}");
    }
    // A rate that the stamps contradict is told, once.
    let stated =
        timed("", &[&first]).replace("<trace>", "<inkSource><sampleRate value=\"100\"/></inkSource><trace>");
    let r = good(&stated.replace("<trace>", &format!("{XYT}<trace>")));
    let told: Vec<String> = r.remarks.iter().map(ToString::to_string).collect();
    assert_eq!(
        (r.rate_hz, told.as_slice()),
        (200.0, &["the file states 100 Hz, its stamps give 200.0 Hz and count".to_owned()][..])
    );
}

#[test]
fn uneven_stamps_since_1970_keep_their_digits() {
    let r = good(&timed(
        " units=\"us\"",
        &[&["1700000000000001", "1700000000008001", "1700000000032001", "1700000000040002"]],
    ));
    let steps: Vec<f64> = r.segments[0].components[0].stamps_s.windows(2).map(|w| w[1] - w[0]).collect();
    for (step, wanted) in steps.iter().zip([0.008, 0.024, 0.008_001]) {
        assert!((step - wanted).abs() < 1e-12, "{steps:?}");
    }
}

#[test]
fn points_without_a_time_are_kept_and_counted() {
    let r = good(&timed("", &[&["?", "5", "?", "'5", "'5", "!25", "?"], &["?", "40"]]));
    let counts: Vec<usize> = r.segments[0].components.iter().map(|c| c.points.len()).collect();
    // The step behind the unknown one is a difference from 5.
    assert_eq!(counts, [7, 2], "{r:?}");
    let [remark] = &r.remarks[..] else { panic!("{:?}", r.remarks) };
    assert!(remark.count == 4 && remark.what.contains("no T"), "{remark}");
    let r = good(&timed("", &[&["0", "5", "?", "15", "20"]]));
    assert_eq!((r.rate_hz, r.segments[0].components[0].points.len()), (200.0, 5));
    // No T at all is no clock.
    let r = good(&timed("", &[&["?", "?"], &["3"]]));
    assert_eq!((r.rate_hz, r.rate_assumed, r.remarks[0].count), (100.0, true, 2));
}

#[test]
fn times_that_do_not_rise_leave_the_points_to_the_stated_rate() {
    let stated =
        |text: String| text.replace("<ink>", "<ink><inkSource><sampleRate value=\"200\"/></inkSource>");
    let (zero, begin) = (["0"; 50], ["250"; 50]);
    let seconds: Vec<String> = (0..1000).map(|k| (1_700_000_000 + k / 200).to_string()).collect();
    let seconds: Vec<&str> = seconds.iter().map(String::as_str).collect();
    for (traces, counts) in [
        (&[&zero[..], &zero[..]][..], &[50, 50][..]),
        (&[&zero[..], &begin[..]], &[50, 50]),
        (&[&seconds[..]], &[1000]),
    ] {
        let r = good(&stated(timed(" units=\"s\"", traces)));
        let found: Vec<usize> = r.segments[0].components.iter().map(|c| c.points.len()).collect();
        assert_eq!((r.rate_hz, r.rate_assumed, found.as_slice()), (200.0, false, counts));
        assert!(r.segments[0].components.iter().all(|c| c.stamps_s.is_empty()));
        assert_eq!(r.remarks.len(), 1, "{:?}", r.remarks);
    }
}

#[test]
fn timestamps_may_be_dates() {
    let file = |first: &str, second: &str| {
        let context = |id: &str, when: &str| {
            format!(
                "<context xml:id=\"{id}\">{}<timestamp xml:id=\"{id}t\" timeString=\"{when}\"/></context>",
                XYT
            )
        };
        let (a, b) = (context("a", first), context("b", second));
        load(
            format!(
                "<ink><definitions>{a}{b}</definitions><trace contextRef=\"#a\">0 0 0,1 0 5,2 0 10</trace>\
                 <trace contextRef=\"#b\">3 0 0,4 0 5</trace></ink>"
            )
            .as_bytes(),
        )
        .unwrap()
    };
    for second in ["2023-11-14T22:13:20.600Z", "2023-11-15T03:43:20.6+05:30"] {
        let r = file("2023-11-14T22:13:20Z", second);
        let gap_s = r.segments[0].components[1].dt_before_s.unwrap();
        assert!((gap_s - 0.59).abs() < 1e-9 && r.rate_hz == 200.0, "{gap_s} {}", r.rate_hz);
        assert_eq!(r.remarks, []);
    }
    let r = file("2023-11-14T22:13:20Z", "yesterday");
    assert!(r.remarks[0].count == 1 && r.remarks[0].what.contains("xsd:dateTime"), "{:?}", r.remarks);
}

#[test]
fn a_rate_that_is_none_is_not_needed_beside_stamps() {
    let rate = "<inkSource><sampleRate value=\"0\"/></inkSource>";
    let r = good(&format!("<ink>{rate}{XYT}<trace>0 0 0,1 0 5,2 0 10</trace></ink>"));
    assert!(r.rate_hz == 200.0 && r.remarks[0].what.contains("sampleRate is \"0\""), "{r:?}");
    let message = load(format!("<ink>\n{rate}<trace>0 0,1 0</trace></ink>").as_bytes()).unwrap_err();
    assert!(message.starts_with("a.inkml:2: sampleRate is \"0\""), "{message}");
}

#[test]
fn resolution_is_the_scale_of_the_values_beside_units_too() {
    let file = |units: &str, value: &str, resolution: &str| {
        good(&format!(
            "<ink><definitions><context xml:id=\"c\"><inkSource><traceFormat>\
             <channel name=\"X\" type=\"integer\" units=\"{units}\"/><channel name=\"Y\" units=\"{units}\"/>\
             </traceFormat><channelProperties>\
             <channelProperty channel=\"X\" name=\"resolution\" value=\"{value}\" units=\"{resolution}\"/>\
             <channelProperty channel=\"Y\" name=\"resolution\" value=\"{value}\" units=\"{resolution}\"/>\
             </channelProperties></inkSource></context></definitions>\
             <trace contextRef=\"#c\">1 2,3 4</trace></ink>"
        ))
    };
    for (units, value, resolution, per_m) in [
        ("cm", "1000", "1/cm", 1e5),
        ("himetric", "1000", "1/cm", 1e5),
        ("himetric", "1", "1/himetric", 1e5),
        ("himetric", "1", "1/dev", 1e5),
        ("", "2540", "dpi", 1e5),
        ("mm", "1/100", "mm", 1e5),
        ("mm", "0.01", "mm", 1e5),
        ("mm", "x", "1/mm", 1e3),
    ] {
        let [x, y] = file(units, value, resolution).units_per_m.unwrap();
        assert!((x / per_m - 1.0).abs() < 1e-12 && x == y, "{units} {value} {resolution}: {x}");
    }
}

#[test]
fn traces_of_several_contexts_come_to_one_unit_and_clock() {
    let r = good(
        r##"<ink><definitions>
<timestamp xml:id="t0" time="5000"/><timestamp xml:id="t1" timestampRef="#t0" timeOffset="1000"/>
<traceFormat xml:id="xy"><channel name="X" units="mm"/><channel name="Y" units="mm"/>
  <channel name="T" units="s" respectTo="#t0"/></traceFormat>
<traceFormat xml:id="f"><channel name="F"/><channel name="T"/><channel name="Y" units="cm"/><channel name="OTx"/>
  <channel name="X" units="cm"/><channel name="B" type="boolean"/></traceFormat>
<context xml:id="a" traceFormatRef="#xy"/><context xml:id="b" traceFormatRef="#f" timestampRef="#t1"/></definitions>
<traceGroup><trace contextRef="#a">10 20 0.0,11 20 0.01</trace>
<trace contextRef="#b">500 100 2 45 1 T,510 110 '0.1'0'0 F</trace></traceGroup></ink>"##,
    );
    assert_eq!(r.units_per_m, Some([1.0; 2]));
    let [first, second] = &r.segments[0].components[..] else { panic!("{:?}", r.segments) };
    let near = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).abs() < 1e-12 && (a[1] - b[1]).abs() < 1e-12;
    assert!(near(first.points[0], [0.01, -0.02]) && near(second.points[0], [0.01, -0.02]), "{r:?}");
    assert!(near(second.points[1], [0.01, -0.021]), "{second:?}");
    // 6.1 s less 5.01 s.
    assert!(second.dt_before_s.is_some_and(|gap_s| (gap_s - 1.09).abs() < 1e-9), "{second:?}");
}

#[test]
fn a_trace_without_a_context_has_the_only_one_and_its_own_duration() {
    let format = "<traceFormat xml:id=\"f\"><channel name=\"Y\"/><channel name=\"X\"/><channel name=\"F\"/></traceFormat>";
    for defined in [
        format.to_owned(),
        format!("<context xml:id=\"c\">{format}</context>"),
        format!("{format}<context xml:id=\"c\" traceFormatRef=\"#f\"/>"),
        format!("<inkSource xml:id=\"s\">{format}</inkSource>"),
    ] {
        let r = good(&format!(
            "<ink><definitions>{defined}</definitions><trace timeOffset=\"100\" duration=\"20\">2 1 9,4 3 9,6 5 9</trace>\
             <trace timeOffset=\"200\" duration=\"10\">2 1 9,4 3 9</trace></ink>"
        ));
        let [first, second] = &r.segments[0].components[..] else { panic!("{:?}", r.segments) };
        assert_eq!(first.points, [[1.0, -2.0], [3.0, -4.0], [5.0, -6.0]], "{defined}");
        assert!((r.rate_hz - 100.0).abs() < 1e-6 && !r.rate_assumed, "{}", r.rate_hz);
        assert!(second.dt_before_s.is_some_and(|gap_s| (gap_s - 0.08).abs() < 1e-9), "{second:?}");
    }
    // Rates of two devices.
    let r = good(
        "<ink><inkSource><sampleRate value=\"100\"/></inkSource><trace>0 0,10 0,20 0</trace>\
         <inkSource><sampleRate value=\"50\"/></inkSource><trace>0 0,20 0,40 0</trace></ink>",
    );
    let lengths: Vec<usize> = r.segments[0].components.iter().map(|c| c.even_points(100.0).len()).collect();
    assert_eq!(lengths, [3, 5]);
}

#[test]
fn continued_traces_are_one_and_utf_16_is_read() {
    let text = "<ink><trace id=\"a\" continuation=\"begin\">1 1</trace><trace>5 5</trace>\
                <trace priorRef=\"#a\" continuation=\"end\">2 2</trace></ink>";
    let wide: Vec<u8> =
        std::iter::once(0xfeffu16).chain(text.encode_utf16()).flat_map(u16::to_le_bytes).collect();
    for r in [good(text), load(&wide).unwrap()] {
        let found: Vec<usize> = r.segments[0].components.iter().map(|c| c.points.len()).collect();
        assert_eq!(found, [2, 1]);
    }
}

#[test]
fn a_trace_may_go_on_in_another_context() {
    let context = |id: &str, format: &str| {
        format!("<context xml:id=\"{id}\"><traceFormat>{format}</traceFormat></context>")
    };
    let [x, y] =
        ["X", "Y"].map(|name| move |units: &str| format!("<channel name=\"{name}\" units=\"{units}\"/>"));
    let t = |units: &str| format!("<channel name=\"T\" units=\"{units}\"/>");
    let file = |first: &str, ink: &str, second: &str, more: &str| {
        load(
            format!(
                "<ink><definitions>{}{}</definitions><trace xml:id=\"t\" contextRef=\"#a\" \
                 continuation=\"begin\">{ink}</trace>\n<trace contextRef=\"#b\" continuation=\"end\" \
                 priorRef=\"#t\">{more}</trace></ink>",
                context("a", first),
                context("b", second)
            )
            .as_bytes(),
        )
    };
    // With T first and without, and the other way round.
    let (plain, stamped) = ([x("mm"), y("mm")].concat(), [x("mm"), y("mm"), t("ms")].concat());
    for (first, ink, second, more) in [
        (&plain, "1 2,3 4,5 6", &stamped, "7 8 10,9 10 20,11 12 30"),
        (&stamped, "1 2 10,3 4 20,5 6 30", &plain, "7 8,9 10,11 12"),
    ] {
        let r = file(first, ink, second, more).unwrap();
        let points = &r.segments[0].components[0].points;
        assert_eq!((points.len(), points[5], r.rate_hz), (6, [11.0, -12.0], 100.0), "{r:?}");
        assert_eq!(r.remarks[0].count, 3, "{:?}", r.remarks);
    }
    // Other units and another order.
    let turned = [t("s"), y("cm"), x("cm")].concat();
    let r = file(&stamped, "1 2 0,3 4 5", &turned, "0.01 0.6 0.5").unwrap();
    assert_eq!(r.segments[0].components[0].points, [[1.0, -2.0], [3.0, -4.0], [5.0, -6.0]]);
    assert_eq!((r.rate_hz, r.segments[0].components.len()), (200.0, 1));
    let message = file(&plain, "1 2", &[x("dev"), y("dev")].concat(), "3 4").unwrap_err();
    assert!(message.starts_with("a.inkml:2: a trace goes on in a context where"), "{message}");
}

#[test]
fn every_refusal_names_file_line_and_reason() {
    let deep = format!("<ink>{}", "<traceGroup>".repeat(70));
    let crowded: String = (0..200_000).map(|n| format!(" a{n}=''")).collect();
    let crowded = format!("<ink>\n<trace{crowded}>1 2</trace></ink>");
    let cases: [(&str, &str); 19] = [
        (&crowded, "a.inkml:2: a tag with more than 256 attributes"),
        ("<ink>\n<trace>1 2,\n3 x</trace></ink>", "a.inkml:3: \"x\" is not a number"),
        ("<ink>\n<trace>1 2,3</trace></ink>", "a.inkml:2: a point has 1 of 2 values"),
        ("<ink>\n<trace>1</tracé></ink>", "a.inkml:2: malformed XML: "),
        ("<ink><trace>1 2</trace>\n", "a.inkml:2: the file ends inside <ink>"),
        ("<svg>\n<ink/></svg>", "a.inkml:1: the document is <svg>; expected <ink>"),
        ("<ink></ink>", "a.inkml: no ink: the file has no trace with points"),
        (
            "<ink><trace type=\"penUp\">1 2</trace></ink>",
            "a.inkml: no ink: the file has no trace with points",
        ),
        (
            "<ink>\n<trace type=\"up\">1 2</trace></ink>",
            "a.inkml:2: trace type \"up\"; legal: penDown, penUp",
        ),
        (
            "<ink>\n<trace contextRef=\"#c\">1 2</trace></ink>",
            "a.inkml:2: contextRef \"#c\" names nothing above it",
        ),
        (
            "<ink><trace>1 2</trace>\n<traceView traceDataRef=\"q\"/></ink>",
            "a.inkml:2: traceDataRef \"q\" names no trace",
        ),
        (
            "<ink><traceFormat><channel name=\"X\"/></traceFormat>\n<trace>1</trace></ink>",
            "a.inkml:2: a traceFormat must have the channels X and Y, found X",
        ),
        (
            "<ink><inkSource>\n<sampleRate value=\"0\"/></inkSource></ink>",
            "a.inkml:2: sampleRate is \"0\"; legal: a number from 0.001 to 1000000",
        ),
        (
            "<ink><traceFormat>\n<channel name=\"X\" orientation=\"up\"/></traceFormat></ink>",
            "a.inkml:2: orientation is \"up\"; legal: +ve, -ve",
        ),
        (
            "<ink><traceFormat><channel name=\"X\" units=\"mm\"/><channel name=\"Y\" units=\"mm\"/></traceFormat>\
             <trace>1 2</trace><traceFormat><channel name=\"X\"/><channel name=\"Y\"/></traceFormat>\
             <trace>1 2</trace></ink>",
            "a.inkml: traces with a unit of length and traces without one in one file",
        ),
        (
            "<ink>\n<trace>1 2</trace><annotation>&bomb;</annotation></ink>",
            "a.inkml:2: unknown entity &bomb;",
        ),
        ("<ink><trace>1 2<b/></trace></ink>", "a.inkml:1: <b> inside a trace, which holds points only"),
        ("<ink><trace>1 2e9</trace></ink>", "a.inkml:1: Y 2000000000 is outside [-1e9, 1e9]"),
        (&deep, "a.inkml:1: elements nested deeper than 64"),
    ];
    for (text, wanted) in cases {
        let message = load(text.as_bytes()).unwrap_err();
        assert!(message.starts_with(wanted), "{message}\nwanted: {wanted}");
    }
}
