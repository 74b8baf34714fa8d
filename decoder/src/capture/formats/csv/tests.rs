//! Rows of all programs; expected values were derived by hand from the programs' documentation.

use super::*;
use crate::capture::testing::read_capture;
use crate::frame::{CanId, FrameFlags};

fn items(text: &str) -> Vec<String> {
    read_capture(text.as_bytes()).items
}

const OURS: &str = "time,bus,id,extended,remote,error,fd,brs,esi,direction,dlc,length,data\n";

#[test]
fn our_own_comes_back_as_it_was() {
    let text = format!(
        "{OURS}\
         1700000000.123456789,can0,701,0,0,0,0,0,0,rx,1,1,05\n\
         -1.500000000,\"can\"\"1\",18FEF100,1,0,0,0,0,0,tx,0,0,\n\
         ,can0,123,0,1,0,0,0,0,,4,4,\n\
         0.000000001,can0,00000088,1,0,1,0,0,0,,8,8,0000040200000208\n\
         0.0,can0,123,0,0,0,1,1,1,,9,12,000102030405060708090A0B\n\
         0.0,can0,123,0,0,0,0,0,0,,13,8,0001020304050607\n\
         0.0,can0,123,0,1,0,0,0,0,,15,8,\n"
    );
    let content = read_capture(text.as_bytes());
    assert_eq!(
        content.items,
        [
            "{1} (1700000000.123456789) bus0 701#05 flags=40 dlc=0",
            "{2} (-1.500000000) bus1 18FEF100# flags=20 dlc=0",
            "{3} bus0 123#R4 flags=01 dlc=0",
            "{4} (0.000000001) bus0 00000088#0000040200000208 flags=02 dlc=0",
            "{5} (0.000000000) bus0 123#000102030405060708090A0B flags=1C dlc=0",
            "{6} (0.000000000) bus0 123#0001020304050607 flags=00 dlc=13",
            "{7} (0.000000000) bus0 123#R8 flags=01 dlc=15",
        ]
    );
    assert_eq!(content.buses, ["can0", "can\"1"]);
}

#[test]
fn a_comment_is_no_part_of_the_frame() {
    let header = OURS.replace('\n', ",comment\n");
    let text = format!(
        "{header}1.0,can0,701,0,0,0,0,0,0,rx,1,1,05,\"a \"\"b\"\", c\"\n1.0,can0,701,0,0,0,0,0,0,rx,1,1,05,\n"
    );
    let content = read_capture(text.as_bytes());
    assert_eq!(content.frames.len(), 2);
    assert_eq!(content.frames[0].data(), content.frames[1].data());
    assert_eq!(content.items.len(), 2);
}

#[test]
fn python_can_writes_base64_and_lengths() {
    let text = "timestamp,arbitration_id,extended,remote,error,dlc,data\n\
                1483389946.197,0xdadada,1,0,0,6,WzQyLCA5XQ==\n\
                1e-05,0x123,0,1,0,4,\n\
                2.0,0x0,0,0,1,0,\n\
                2.5,0x88,0,0,1,8,AAAEAgAAAgg=\n\
                3.0,0x7ff,0,0,0,12,AAECAwQFBgcICQoL\n";
    assert_eq!(
        items(text),
        [
            // The documentation of python-can encodes b"[42, 9]": seven bytes, while its length is 6.
            "line 2: data: expected as many bytes as the length; found \"1483389946.197,0xdadada,1,0,0,6,WzQyLCA5XQ==\"",
            "{1} (0.000010000) bus0 123#R4 flags=01 dlc=0",
            "{2} (2.000000000) bus0 00000088#0000000000000000 flags=02 dlc=0",
            "{3} (2.500000000) bus0 00000088#0000040200000208 flags=02 dlc=0",
            "{4} (3.000000000) bus0 7FF#000102030405060708090A0B flags=04 dlc=0",
        ]
    );
}

#[test]
fn savvycan_of_both_ages_and_generic() {
    let new =
        "Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8\n39747828,000005EB,false,Tx,0,2,E8,45,\n";
    assert_eq!(items(new), ["{1} (39.747828000) bus0 5EB#E845 flags=20 dlc=0"]);
    let old = "Time Stamp,ID,Extended,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8\n166064000,18FEF100,true,1,1,FF,00,00,00,00,00,00,00,\n";
    let content = read_capture(old.as_bytes());
    assert_eq!(content.items, ["{1} (166.064000000) bus0 18FEF100#FF flags=00 dlc=0"]);
    assert_eq!(content.buses, ["1"]);
    let generic = "ID,Data Bytes\n0000021A,FE 36 12 \n18FEF100,\n";
    assert_eq!(
        items(generic),
        [
            "identifier type not recorded: identifiers above 7FF read as 29-bit",
            "{1} bus0 21A#FE3612 flags=00 dlc=0",
            "{2} bus0 18FEF100# flags=00 dlc=0",
        ]
    );
}

#[test]
fn css_electronics_with_and_without_the_later_columns() {
    let text = "TimestampEpoch;BusChannel;ID;IDE;DLC;DataLength;Dir;EDL;BRS;ESI;RTR;DataBytes\n\
                1670926807.419500;1;7FF;0;1;1;0;0;0;0;0;AA\n\
                1670926807.419900;2;00000001;1;9;12;1;1;1;1;0;AAAAAAAAAAAAAAAAAAAAAAAA\n\
                1670926808.000000;1;123;0;8;8;0;0;0;0;1;\n";
    assert_eq!(
        items(text),
        [
            "{1} (1670926807.419500000) bus0 7FF#AA flags=40 dlc=0",
            "{2} (1670926807.419900000) bus1 00000001#AAAAAAAAAAAAAAAAAAAAAAAA flags=3C dlc=0",
            "{3} (1670926808.000000000) bus0 123#R8 flags=41 dlc=0",
        ]
    );
    let early =
        "TimestampEpoch;BusChannel;ID;IDE;DLC;DataLength;Dir;EDL;BRS;DataBytes\n1.0;1;123;0;0;0;0;1;0;\n";
    assert_eq!(items(early), ["{1} (1.000000000) bus0 123# flags=44 dlc=0"]);
}

#[test]
fn ixxat_behind_its_heading() {
    let text = "ASCII Trace IXXAT MiniMon V3  Version: 1.1.4.4533\nDate: 5/9/2024\nStart time: 2:37:37 PM\n\
                Stop time: 2:37:37 PM\nOverruns:          \nBaudrate: 500 kbit/s\n\
                \"Time\",\"Identifier (hex)\",\"Format\",\"Flags\",\"Data (hex)\"\n\
                \"00:30:06.866\",\"184\",\"Std\",\"\",\"00 06 00 16\"\n\
                \"00:30:06.867\",\"18FEF100\",\"Ext\",\"\",\"\"\n\
                \"00:30:07.000\",\"701\",\"Std\",\"Rtr\",\"Remote request DLC=1\"\n";
    let expected = [
        "{1} (1806.866000000) bus0 184#00060016 flags=00 dlc=0",
        "{2} (1806.867000000) bus0 18FEF100# flags=00 dlc=0",
        "{3} (1807.000000000) bus0 701#R1 flags=01 dlc=0",
    ];
    assert_eq!(items(text), expected);
    assert_eq!(items(&text.replace("\",\"", "\";\"")), expected);
}

#[test]
fn kvaser_in_both_bases() {
    let header = |base: &str| {
        format!(
            "CSV CAN data\nConverted from Kvaser Memorator at,2015-10-12 12:34:56\n\nFormat of data field,{base}\nFormat of id field,{base}\nTimestamp Offset, 0.0,seconds\nTime,Channel,id,Flags,DLC,Data0,Data1,Data2,Data3,Data4,Data5,Data6,Data7,Counter,AbsTime\n"
        )
    };
    let rows = "1.50000,1,291,2,2,16,255,,,,,,,1,x\n";
    assert_eq!(items(&(header("DEC") + rows)), ["{1} (1.500000000) bus0 123#10FF flags=40 dlc=0"]);
    let rows = "1.50000,2,18fef100,68,1,0a,,,,,,,,1,x\n1.6,1,,34,,,,,,,,,,2,x\n1.7,1,123,130,0,,,,,,,,,3,x\n1.8,1,123,514,0,,,,,,,,,4,x\n1.9,1,123,3,8,,,,,,,,,5,x\n";
    assert_eq!(
        items(&(header("HEX") + rows)),
        [
            "{1} (1.500000000) bus0 18FEF100#0A flags=20 dlc=0",
            "{2} (1.600000000) bus1 00000088#0000000000000000 flags=42 dlc=0",
            "requests to send ignored",
            "line 11: frames lost",
            "{3} (1.800000000) bus1 123# flags=40 dlc=0",
            "{4} (1.900000000) bus1 123#R8 flags=41 dlc=0",
        ]
    );
}

#[test]
fn netronics_with_its_notes_and_key() {
    let text = "~~~~\nlog - 9:54:22 AM 2/18/2012 - Hexadecimal\n~~~~\n\nTYPE,TIME,ID,D1,D2,D3,D4,D5,D6,D7,D8\r\n\
                TD11,0,1,\t\t;A note, with a comma\r\nRD11,0.0458,588,0,0,84\r\nTR29,0.5,18FEF100\r\nEF,0.6\r\nBO,0.7\r\n!,0.8\r\nST,0.9\r\n\
                Key\r\nRD = Receive Data\r\n";
    assert_eq!(
        items(text),
        [
            "{1} (0.045800000) bus0 588#000084 flags=40 dlc=0",
            "{2} (0.500000000) bus0 18FEF100#R0 flags=21 dlc=0",
            "{3} (0.600000000) bus0 00000088#0000000000000000 flags=02 dlc=0",
            "{4} (0.700000000) bus0 00000040#0000000000000000 flags=02 dlc=0",
            "line 11: frames lost",
            "{5} (0.800000000) bus0 00000004#0001000000000000 flags=02 dlc=0",
        ]
    );
}

#[test]
fn the_decoded_traces_of_canopen_message_interpreter() {
    let text = "Message Number;Time [ms];ID;DLC;Data Bytes;CANopen;Node;Index;Subindex;Interpretation\r\n\
                1;144,500;0x0728;1;[0x7f];ERR_CTRL;40;-;-;Heartbeat: Preoperational\r\n\
                6;234,700;0x070a;1;;ERR_CTRL;10;-;-;Node-Guarding Request (RTR)\r\n\
                7;235,000;0x0080;0;;SYNC;-;-;-;\r\n";
    let [_, rows @ ..] = &items(text)[..] else { panic!("nothing") };
    assert_eq!(
        rows,
        [
            "{1} (0.144500000) bus0 728#7F flags=00 dlc=0",
            "{2} (0.234700000) bus0 70A#R1 flags=01 dlc=0",
            "{3} (0.235000000) bus0 080# flags=00 dlc=0",
        ]
    );
}

#[test]
fn broken_rows_say_what_was_expected_and_a_second_header_is_none() {
    let row = |fields: &str| format!("1.0,can0,{fields}\n");
    let text = [
        OURS,
        "x,can0,701,0,0,0,0,0,0,rx,1,1,05\n",
        &row("800,0,0,0,0,0,0,rx,0,0,"),
        &row("7g1,0,0,0,0,0,0,rx,0,0,"),
        &row("701,2,0,0,0,0,0,rx,0,0,"),
        &row("701,0,0,0,0,0,0,up,0,0,"),
        &row("701,0,0,0,0,0,0,rx,300,0,"),
        &row("701,0,0,0,0,0,0,rx,2,2,05"),
        &row("701,0,0,0,0,0,0,rx,1,1,5x"),
        &row("701,0,0,0,0,0,0,rx,9,9,000000000000000000"),
        "1.0\n",
        OURS,
        &row("701,0,0,0,0,0,0,rx,1,1,05"),
    ]
    .concat();
    let content = read_capture(text.as_bytes());
    let expected = [
        "time",
        "identifier",
        "identifier",
        "flag",
        "direction",
        "length",
        "data",
        "data",
        "length",
        "identifier",
    ];
    assert_eq!(content.items.len(), expected.len() + 1, "{:?}", content.items);
    for (index, (item, part)) in content.items.iter().zip(expected).enumerate() {
        assert!(item.starts_with(&format!("line {}: {part}: ", index + 2)), "{item}");
    }
    let [frame] = content.frames[..] else { panic!("one frame") };
    assert_eq!((frame.id, frame.flags), (CanId::Standard(0x701), FrameFlags::RECEIVED));
}

#[test]
fn a_table_without_a_known_header_is_not_recognised() {
    for head in ["a,b,c\n1,2,3\n", "", "id\n701\n", "(1.0) can0 701#05\n"] {
        assert!(!(FORMAT.detect)(head.as_bytes()), "{head}");
    }
    assert!((FORMAT.detect)(OURS.as_bytes()));
    assert!((FORMAT.detect)("\u{FEFF}ID,Data Bytes\r\n".as_bytes()));
}

const ZLG: &str = "序号,系统时间,时间标识,CAN通道,传输方向,ID号,帧类型,帧格式,长度,数据\r\n\
                   00000,=\"23:59:59.900\",0x592897,ch1,接收,0x0601,数据帧,标准帧,0x08,x| 40 18 10 01 00 00 00 00 \r\n\
                   00001,=\"00:00:00.150\",0x59289C,ch2,发送,0x00F02A81,数据帧,扩展帧,0x02,x| 03 7D FD 7C \r\n\
                   00002,=\"00:00:00.150\",无,ch1,接收,0x0701,远程帧,标准帧,0x01,\r\n";

const ZLG_ITEMS: [&str; 4] = [
    "times of day without a date: times count from the midnight before the first frame",
    "{1} (86399.900000000) bus0 601#4018100100000000 flags=40 dlc=0",
    "{2} (86400.150000000) bus1 00F02A81#037D flags=20 dlc=0",
    "{3} (86400.150000000) bus0 701#R1 flags=41 dlc=0",
];

/// Rows in the form of USB_CAN TOOL: a spreadsheet keeps `="…"` as text; the length limits the data.
#[test]
fn zlg_in_utf_8_and_gbk_passes_midnight() {
    let gbk = encoding_rs::GBK.encode(ZLG).0;
    for bytes in [ZLG.as_bytes(), &gbk, &[b"\xEF\xBB\xBF", ZLG.as_bytes()].concat()] {
        let content = read_capture(bytes);
        assert_eq!(content.items, ZLG_ITEMS);
        assert_eq!(content.buses, ["ch1", "ch2"]);
    }
}

#[test]
fn a_broken_character_in_gbk_costs_its_word_only() {
    let gbk = encoding_rs::GBK.encode(ZLG).0;
    let word = encoding_rs::GBK.encode("接收").0;
    let at = memchr::memmem::find(&gbk, &word).unwrap();
    let mut broken = gbk.to_vec();
    broken[at] = 0xFF;
    let content = read_capture(&broken);
    assert_eq!(content.frames.len(), 3);
    assert_eq!(content.items[2], ZLG_ITEMS[1].replace("flags=40", "flags=00"));
    assert!(content.items[1].starts_with("words with invalid characters"), "{:?}", content.items);
}

/// CANTest has other names and another order; CANalyst FD adds the type of bus; without the time of the computer, that
/// of the adapter is used: 0x592897 is 5,843,095 × 0.1 ms.
#[test]
fn other_heads_and_clocks_of_zlg() {
    for (text, expected) in [
        (
            "序号,传输方向,时间标识,名称,帧ID(靠右对齐),帧格式,帧类型,数据长度,数据(HEX)\n\
             0,接收,15:56:04.367.0,,0x00000181,数据帧,标准帧,0x02,11 22\n",
            "{1} (57364.367000000) bus0 181#1122 flags=40 dlc=0",
        ),
        (
            "序号,系统时间,时间标识,CAN通道,ID号,帧类型,帧格式,CAN类型,长度,数据\n\
             1,=\"17:54:13.761949,385.624895,ch1,0x27,数据帧,标准帧,CANFD,12,x| 01 02 03 04 05 06 07 08 09 0A 0B 0C\n",
            "{1} (64453.761949000) bus0 027#0102030405060708090A0B0C flags=04 dlc=0",
        ),
        (
            "序号,系统时间,时间标识,CAN通道,传输方向,ID号,帧类型,帧格式,长度,数据\n\
             0,无,0x592897,ch1,接收,0x0601,数据帧,标准帧,1,x| 40\n",
            "{1} (584.309500000) bus0 601#40 flags=40 dlc=0",
        ),
        (
            "Index,System Time,Time Stamp,Channel,Direction,ID,Type,Format,Len,Data\n\
             0,=\"09:15:30.250\",0x592897,ch1,Receive,0x601,Data,Standard,0x01,x| 40\n",
            "{1} (33330.250000000) bus0 601#40 flags=40 dlc=0",
        ),
    ] {
        let found = items(text);
        assert_eq!(found.last().unwrap(), expected, "{found:?}");
    }
    let further = "00003,=\"00:00:00.150\",无,ch1,接收,0x0701,数据帧,标准帧,0x01,x| 05 \r\n".repeat(20);
    let wrong = items(&format!("{}{further}", ZLG.replace("远程帧", "奇怪")));
    assert!(wrong.iter().any(|item| item.starts_with("line 4: frame type: expected")), "{wrong:?}");
}

const GVRET: &str = "Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8\n";

/// 64 bits of microseconds overflowed in the program: the differences are right.
#[test]
fn negative_dates_count_from_the_first_frame() {
    let text = format!(
        "{GVRET}-1767062175875212,00000705,false,Rx,0,1,05,\r\n\
         -1767062175874870,00000185,false,Rx,0,2,01,00,\r\n-1767062175864615,00000185,false,Tx,1,1,02,\r\n"
    );
    assert_eq!(
        items(&text),
        [
            "dates before 1970 (an overflow of the writer): times count from the first frame",
            "{1} (0.000000000) bus0 705#05 flags=40 dlc=0",
            "{2} (0.000342000) bus0 185#0100 flags=40 dlc=0",
            "{3} (0.010597000) bus1 185#02 flags=20 dlc=0",
        ]
    );
    let dated = items(&format!("{GVRET}1700000000000001,00000705,false,Rx,0,1,05,\n"));
    assert_eq!(dated, ["{1} (1700000000.000001000) bus0 705#05 flags=40 dlc=0"]);
}

/// Rows without data bytes, `step` units apart, on each of `buses` buses in turn.
fn rows_apart(count: u32, step: u32, buses: u32) -> String {
    let row = |n: u32| format!("{},00000705,false,Rx,{},0,\n", n / buses * step, n % buses);
    format!("{GVRET}{}", (0..count).map(row).collect::<String>())
}

/// The shortest frame takes 47 µs at 1 Mbit/s.
#[test]
fn the_unit_of_gvret_fits_a_bus() {
    const MILLISECONDS: &str = "times read as milliseconds: as microseconds, no bus could carry the frames; --time-unit us reads \
                                microseconds";
    for (count, step, buses, last, is_assumed) in [
        (40, 47, 1, 39 * 47_000, false),
        (40, 46, 1, 39 * 46_000_000, true),
        // 20 frames of each of two buses at the same times.
        (40, 47, 2, 19 * 47_000, false),
        (19, 1, 1, 18_000, false),
        // Too fast even in milliseconds: the program's own unit.
        (40, 0, 1, 0, false),
    ] {
        let text = rows_apart(count, step, buses);
        let whole = read_capture(text.as_bytes());
        let pieces = crate::capture::testing::read_in_pieces(text.as_bytes(), &[1, 7, 30]);
        assert_eq!(whole, pieces, "{count} rows, {step} apart");
        let time = whole.frames.last().unwrap().time.unwrap().0;
        assert_eq!((time, whole.items[0] == MILLISECONDS), (last, is_assumed), "{count} rows, {step} apart");
    }
}

#[test]
fn the_user_states_the_unit() {
    let read = |unit: Option<TimeUnit>| {
        let options = ReadOptions { time_unit: unit, ..ReadOptions::default() };
        let mut parser = (FORMAT.parser)(&options);
        let mut batch = Batch::new();
        parser.parse(rows_apart(40, 46, 1).as_bytes(), true, &mut batch).unwrap();
        let last = batch.frames().last().and_then(|frame| frame.time).map(|time| time.0);
        (last.unwrap(), batch.notices().len())
    };
    let ticks = 39 * 46;
    assert_eq!(read(Some(TimeUnit::Microsecond)), (ticks * 1_000, 0));
    assert_eq!(read(Some(TimeUnit::Nanosecond)), (ticks, 0));
    assert_eq!(read(Some(TimeUnit::Second)), (ticks * 1_000_000_000, 0));
    assert_eq!(read(None), (ticks * 1_000_000, 1));
}

/// The number of bytes replaces a missing length; a DLC above 8 has eight bytes.
#[test]
fn fewer_columns_than_those_of_savvycan() {
    for (text, expected) in [
        ("Time Stamp,ID,D1,D2\n5,705,05,\n", "{1} (0.000005000) bus0 705#05 flags=00 dlc=0"),
        (
            "Time Stamp;ID;Extended;Dir;Bus;DLC;D1;D2;D3;D4;D5;D6;D7;D8\n\
             5;18FEF100;true;Tx;can1;2;01;02;00;00;00;00;00;00\n",
            "{1} (0.000005000) bus0 18FEF100#0102 flags=20 dlc=0",
        ),
    ] {
        assert_eq!(items(text).last().unwrap(), expected);
    }
}
