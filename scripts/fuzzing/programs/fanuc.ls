/PROG  FANUC
/ATTR
COMMENT		= "job";
LINE_COUNT	= 6;
/MN
   1:  !  moves ;
   2:  UFRAME_NUM=0 ;
   3:  UTOOL_NUM=0 ;
   4:J P[1] 50% FINE     ;
   5:  PAYLOAD[2] ;
   6:L P[2:"x"] 100mm/sec CNT10     ;
/POS
P[1]{
   GP1:
	UF : 0, UT : 0,
	J1=    10.000 deg,	J2=    17.009 deg,	J3=     9.462 deg,
	J4=    20.000 deg,	J5=   -45.231 deg,	J6=   -10.000 deg
};
P[2]{
   GP1:
	UF : 0, UT : 0,		CONFIG : 'N U T, 0, 0, 0',
	X =   800.000  mm,	Y =    50.000  mm,	Z =   600.000  mm,
	W =   180.000  deg,	P =    10.000  deg,	R =     0.000  deg
};
/END
